// What the judge measures, from the caller's data: complementarity/residuals.py has the definitions, judge.py the
// verdict.
#pragma once

#include "group.h"

namespace jaxcontact {

// backward_error and telling: an answer within both needs no certificate, whatever the judge says of the rest.
struct JudgeRules {
  static constexpr int degeneracy = 64, pivot_floor = 16, certificate = 64;
  template <class Real>
  static constexpr Real backward_error = (sizeof(Real) == 8 ? 256 : 16) * eps<Real>;
  template <class Real>
  static constexpr Real telling = sizeof(Real) == 8 ? Real(1) / (1 << 13) : Real(1) / (1 << 6);
};

// Bits of `flags`. PROVED: the certificate excludes a feasible point; DEPENDENT: no mode is regular.
enum Flags : int { DATA_FINITE = 1, POINT_FINITE = 2, PROVED = 4, DEPENDENT = 8 };

// A problem of m contacts at a point z, for N a number or a group of lanes: w = M z + q, terms = |M||z| + |q|, t the
// stiffness of each row, up = 2^rows and down = 2^-rows the balanced units.
template <class N>
struct Point {
  int m;
  const N *q, *z, *w, *terms, *t, *up, *down;


  // z / Z and w / W over a common denominator: z times `z`, w times `w`, over `whole`, which is about one.
  struct Shares {
    N z, w, whole;

    Shares(N Z, N W) : z(per_power_of_two(Z)), w(per_power_of_two(W)) {
      const N unit_z = one_if_zero(Z * z), unit_w = one_if_zero(W * w);
      z *= unit_w, w *= unit_z, whole = unit_z * unit_w;
    }
  };

  Shares balanced() const {
    N Z{}, W{};
    for (int i = 0; i < m; ++i) {
      Z = larger(Z, size_of(z[i]) * down[i]);
      W = larger(W, terms[i] * up[i]);
    }
    return {Z, W};
  }

  void errors(N* eta, N* rho) const {
    N Z{}, W{}, load{}, miss{}, one{}, other{};
    for (int i = 0; i < m; ++i) {
      Z = larger(Z, size_of(z[i]));
      W = larger(W, terms[i]);
      load = larger(load, size_of(q[i]));
      const N scaled = t[i] * z[i];
      miss = larger(miss, size_of(scaled < w[i] ? scaled : w[i]));
    }
    *rho = miss / one_if_zero(load);
    const Shares plain(Z, W), fair = balanced();
    for (int i = 0; i < m; ++i) {
      const N a = z[i] * plain.z, b = w[i] * plain.w, c = z[i] * down[i] * fair.z, d = w[i] * up[i] * fair.w;
      one = larger(one, size_of(a < b ? a : b));
      other = larger(other, size_of(c < d ? c : d));
    }
    const auto second = other * plain.whole > one * fair.whole;
    *eta = (second ? other : one) / (second ? fair.whole : plain.whole);
  }

  template <class Real, class Mask>
  void classes(Mask* active, Mask* degenerate) const {
    const Shares fair = balanced();
    const N zero = JudgeRules::degeneracy * eps<Real> * fair.whole;
    for (int i = 0; i < m; ++i) {
      const N c = z[i] * down[i] * fair.z, d = w[i] * up[i] * fair.w;
      active[i] = (c > zero) & ((d <= zero) | (c > d));
      degenerate[i] = (c <= zero) & (d <= zero);
    }
  }
};

template <class Real>
inline Real stiffness_of(const Real* row, int i, int m) {
  if (row[i] > 0) return row[i];
  Real side = 0;
  for (int j = 0; j < m; ++j) side = larger(side, size_of(row[j]));
  return side > 0 ? side : 1;
}

// Where one problem's results go.
template <class Real>
struct Found {
  Real *eta, *rho;
  int* flags;
};

template <class Real>
struct Classes {
  Real* w;
  bool *active, *degenerate;
};

template <class Real>
inline bool all_finite(const Real* x, int n) {
  constexpr int W = Format<Real>::width;
  Lanes<Real> sums{};  // zero, or NaN
  Real sum = 0;
  int i = 0;
  for (; i + W <= n; i += W) sums += lanes_at(x + i) - lanes_at(x + i);
  for (; i < n; ++i) sum += x[i] - x[i];
  return sum + sum_of_lanes(sums) == 0;
}

// y'A_j with the error of twice the working precision (Dot2 of Ogita, Rump and Oishi), and |y|'|A_j|.
template <class Real>
inline Real accurate_product(const Real* y, const Real* A, int j, int m, Real* terms) {
  Real total = 0, error = 0;
  *terms = 0;
  for (int i = 0; i < m; ++i) {
    const Real product = y[i] * A[i * m + j], lost = std::fma(y[i], A[i * m + j], -product);
    const Real sum = total + product, part = sum - total;
    error += lost + ((total - (sum - part)) + (product - part));
    total = sum;
    *terms += size_of(product);
  }
  return total + error;
}

// Whether no z, w >= 0 satisfy P z - N w + q = 0, by y: judge.infeasible without free unknowns. N null: the identity.
// unit_z, unit_w: powers of two that make all z comparable, and all w.
template <class Real>
bool proves(const Real* P, const Real* N, const Real* q, const Real* y, int m, const Real* unit_z, const Real* unit_w) {
  const Real rounding = (m * eps<Real>)*(m * eps<Real>);
  Real load = 0, sizes = 0, heaviest = 0, of_P = 0, of_N = 0;
  for (int i = 0; i < m; ++i) {
    load += y[i] * q[i];
    sizes += size_of(y[i] * q[i]);
    heaviest = larger(heaviest, size_of(q[i]));
  }
  load -= m * eps<Real> * sizes;
  if (!(load > 0)) return false;
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) {
      of_P = larger(of_P, size_of(P[i * m + j]) / unit_z[j]);
      of_N = larger(of_N, (N ? size_of(N[i * m + j]) : Real(i == j)) / unit_w[j]);
    }
  const Real allowed = JudgeRules::certificate * rounding * load / (heaviest > 0 ? heaviest : 1);
  for (int j = 0; j < m; ++j) {
    Real terms, product = accurate_product(y, P, j, m, &terms);
    if (!((larger(-product, Real(0)) + rounding * terms) / unit_z[j] <= allowed * (of_P > 0 ? of_P : 1))) return false;
    product = y[j], terms = size_of(y[j]);
    if (N) product = accurate_product(y, N, j, m, &terms);
    if (!((larger(product, Real(0)) + rounding * terms) / unit_w[j] <= allowed * (of_N > 0 ? of_N : 1))) return false;
  }
  return true;
}

// One problem made ready for `measure`: its rows padded (work.M), stiffness and balanced units of each.
template <int S, class Real>
void prepare(const Real* M, Workspace<Real>& work) {
  const int m = work.m, stride = S ? S : work.stride;
  Real *t = work.right.data(), *up = work.best.data(), *down = work.ratio.data();
  row_exponents(M, m, work.rows.data());
  for (int i = 0; i < m; ++i) {
    copy_row<S>(M + i * m, m, stride, work.M.data() + i * stride);
    t[i] = stiffness_of(M + i * m, i, m);
    up[i] = power_of_two<Real>(work.rows[i]);
    down[i] = power_of_two<Real>(-work.rows[i]);
  }
}

// That problem at a point x (padded); w is work.miss.
template <int S, class Real>
Point<Real> at_point(const Real* q, const Real* x, Workspace<Real>& work) {
  const int m = work.m, stride = S ? S : work.stride;
  Real *w = work.miss.data(), *terms = work.column.data();
  for (int i = 0; i < m; ++i) {
    const Real* row = work.M.data() + i * stride;
    Lanes<Real> sum{}, size{};
    for (int j = 0; j < stride; j += Format<Real>::width) {
      const Lanes<Real> product = lanes_at(row + j) * lanes_at(x + j);
      sum += product;
      size += size_of(product);
    }
    w[i] = q[i] + sum_of_lanes(sum);
    terms[i] = size_of(q[i]) + sum_of_lanes(size);
  }
  return {m, q, x, w, terms, work.right.data(), work.best.data(), work.ratio.data()};
}

template <class Real>
void measure(const Point<Real>& point, const Found<Real>& found) {
  point.errors(found.eta, found.rho);
  const bool whole = all_finite(point.z, point.m) && all_finite(point.w, point.m);
  if (!whole) *found.eta = *found.rho = not_a_number<Real>;  // comparisons above may have dropped it
  *found.flags = whole ? POINT_FINITE : 0;
}

// An answer within both bounds needs no certificate.
template <class Real, class N>
inline auto clear(N eta, N rho) {
  return (eta <= JudgeRules::backward_error<Real>)&(rho <= JudgeRules::telling<Real>);
}

// The rest of what is said of a point, once it is final.
template <class Real>
inline void write_flags(const Real* M, const Point<Real>& point, const Real* certificate, const Found<Real>& found) {
  const int m = point.m;
  if (all_finite(M, m * m) && all_finite(point.q, m)) *found.flags |= DATA_FINITE;
  if (!clear<Real>(*found.eta, *found.rho) && proves<Real>(M, nullptr, point.q, certificate, m, point.down, point.up))
    *found.flags |= PROVED;
}

// One problem of any size.
template <int S, class Real>
void findings(const Real* M, const Real* q, const Real* z, const Real* certificate, Workspace<Real>& work,
              const Found<Real>& found) {
  prepare<S>(M, work);
  copy_row<S>(z, work.m, work.stride, work.z.data());
  const Point<Real> point = at_point<S>(q, work.z.data(), work);
  measure(point, found);
  write_flags(M, point, certificate, found);
}

template <int S, class Real>
void classes(const Real* M, const Real* q, const Real* z, Workspace<Real>& work, const Classes<Real>& to) {
  prepare<S>(M, work);
  copy_row<S>(z, work.m, work.stride, work.z.data());
  const Point<Real> point = at_point<S>(q, work.z.data(), work);
  point.template classes<Real>(to.active, to.degenerate);
  for (int i = 0; i < work.m; ++i) to.w[i] = point.w[i];
}

// A group of problems as the judge sees them: the caller's numbers, and units that make rows comparable.
template <int m, class Real>
struct GroupJudge {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const Given<m, Real>& given;
  V t[m], up[m], down[m];
  V x[m], w[m], terms[m], eta, rho;
  K whole;

  explicit GroupJudge(const Given<m, Real>& given) : given(given) {
    for (int i = 0; i < m; ++i) {
      t[i] = given.A[i][i];
      up[i] = powers_of_two<Real>(given.rows[i]);
      down[i] = powers_of_two<Real>(-given.rows[i]);
    }
    if (!any_lane<Real>(~given.plain)) return;
    for (int lane = 0; lane < given.count; ++lane) {
      if (given.plain[lane]) continue;
      int own[m];
      const Real* M = given.M + lane * m * m;
      row_exponents(M, m, own);
      for (int i = 0; i < m; ++i) {
        t[i][lane] = stiffness_of(M + i * m, i, m);
        up[i][lane] = power_of_two<Real>(own[i]);
        down[i][lane] = power_of_two<Real>(-own[i]);
      }
    }
  }

  Point<V> at(const V (&z)[m]) {
    for (int i = 0; i < m; ++i) {
      x[i] = z[i];
      w[i] = given.load[i];
      terms[i] = size_of(w[i]);
      for (int j = 0; j < m; ++j) {
        const V product = given.A[i][j] * z[j];
        w[i] += product;
        terms[i] += size_of(product);
      }
    }
    return {m, given.load, x, w, terms, t, up, down};
  }

  void measure(const V (&z)[m]) {
    at(z).errors(&eta, &rho);
    V point{};  // zero, or NaN
    for (int i = 0; i < m; ++i) point += x[i] - x[i] + (w[i] - w[i]);
    whole = point == 0;
    eta = whole ? eta : all(not_a_number<Real>);  // comparisons above may have dropped it
    rho = whole ? rho : all(not_a_number<Real>);
  }

  // What was measured last; certificates are looked at where a lane needs one.
  void write(const Real* certificate, const Found<Real>& found) const {
    const int count = given.count;
    V data{};
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) data += given.A[i][j] - given.A[i][j];
      data += given.load[i] - given.load[i];
    }
    const K flags = (data == 0 ? K{} + int(DATA_FINITE) : K{}) | (whole ? K{} + int(POINT_FINITE) : K{});
    write_lanes<1>(&eta, count, found.eta);
    write_lanes<1>(&rho, count, found.rho);
    write_integers<Real>(flags, count, found.flags);
    const K doubtful = ~clear<Real>(eta, rho);
    if (!any_lane<Real>(doubtful)) return;
    for (int lane = 0; lane < count; ++lane) {
      if (!doubtful[lane]) continue;
      Real unit_z[m], unit_w[m];
      for (int i = 0; i < m; ++i) unit_z[i] = down[i][lane], unit_w[i] = up[i][lane];
      const Real* nothing = nullptr;
      if (proves(given.M + lane * m * m, nothing, given.q + lane * m, certificate + lane * m, m, unit_z, unit_w))
        found.flags[lane] |= PROVED;
    }
  }
};

// A group at points that stand in memory.
template <int m, class Real>
void findings_of_group(const Given<m, Real>& given, const Real* z, const Real* certificate, const Found<Real>& found) {
  Lanes<Real> x[m];
  GroupJudge<m, Real> judge(given);
  read_lanes<m>(z, given.count, x);
  judge.measure(x);
  judge.write(certificate, found);
}

template <int m, class Real>
void classes_of_group(const Given<m, Real>& given, const Real* z, const Classes<Real>& to) {
  Lanes<Real> x[m];
  Masks<Real> active[m], degenerate[m];
  GroupJudge<m, Real> judge(given);
  read_lanes<m>(z, given.count, x);
  judge.at(x).template classes<Real>(active, degenerate);
  write_lanes<m>(judge.w, given.count, to.w);
  write_masks<m, Real>(active, given.count, to.active);
  write_masks<m, Real>(degenerate, given.count, to.degenerate);
}

}  // namespace jaxcontact
