// What the judge measures, from the caller's data: complementarity/residuals.py has the definitions, judge.py the verdict.
#pragma once

#include "group.h"

namespace jaxcontact {

struct JudgeRules {
  static constexpr int degeneracy = 64, pivot_floor = 16;
};

// Bits of `flags`.
enum Flags : int { DATA_FINITE = 1, POINT_FINITE = 2 };

template <class N>
inline N bigger(N a, N b) {
  return b > a ? b : a;
}

// eta, rho and masks from the products: N is a number or a group of lanes, z and w the point, terms = |M||z| + |q|,
// t the stiffness of each row, up = 2^rows and down = 2^-rows the balanced units.
template <class N, class Mask>
inline void measured(int m, N degenerate_below, const N* q, const N* z, const N* w, const N* terms, const N* t,
                     const N* up, const N* down, N* eta, N* rho, Mask* active, Mask* degenerate) {
  const auto size = [](N x) { return x < 0 ? -x : x; };
  const auto per = [](N x) { return 1 / (x > 0 ? x : x - x + 1); };
  N size_z{}, size_w{}, load{}, miss{}, balanced_z{}, balanced_w{};
  for (int i = 0; i < m; ++i) {
    size_z = bigger(size_z, size(z[i]));
    size_w = bigger(size_w, terms[i]);
    balanced_z = bigger(balanced_z, size(z[i]) * down[i]);
    balanced_w = bigger(balanced_w, terms[i] * up[i]);
    load = bigger(load, size(q[i]));
    const N scaled = t[i] * z[i];
    miss = bigger(miss, size(scaled < w[i] ? scaled : w[i]));
  }
  *rho = miss * per(load);
  const N per_z = per(size_z), per_w = per(size_w), fair_z = per(balanced_z), fair_w = per(balanced_w);
  N most{};
  for (int i = 0; i < m; ++i) {
    const N a = z[i] * per_z, b = w[i] * per_w, c = z[i] * down[i] * fair_z, d = w[i] * up[i] * fair_w;
    most = bigger(most, size(a < b ? a : b));
    most = bigger(most, size(c < d ? c : d));
    active[i] = (c > degenerate_below) & ((d <= degenerate_below) | (c > d));
    degenerate[i] = (c <= degenerate_below) & (d <= degenerate_below);
  }
  *eta = most;
}

template <class Real>
inline Real stiffness_of(const Real* row, int i, int m) {
  if (row[i] > 0) return row[i];
  Real side = 0;
  for (int j = 0; j < m; ++j) side = larger(side, size_of(row[j]));
  return side > 0 ? side : 1;
}

// Where one lane's results go.
template <class Real>
struct Found {
  Real *w, *eta, *rho;
  bool *active, *degenerate;
  int* flags;
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

template <class Real>
inline void write_flags(const Real* M, const Real* q, const Real* z, int m, const Found<Real>& found) {
  const bool point = all_finite(z, m) && all_finite(found.w, m);
  *found.flags = (all_finite(M, m * m) && all_finite(q, m) ? DATA_FINITE : 0) | (point ? POINT_FINITE : 0);
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

// A point x (padded) of that problem.
template <int S, class Real>
void measure(const Real* q, const Real* x, Workspace<Real>& work, const Found<Real>& found) {
  const int m = work.m, stride = S ? S : work.stride;
  Real* terms = work.column.data();
  for (int i = 0; i < m; ++i) {
    const Real* row = work.M.data() + i * stride;
    Lanes<Real> sum{}, size{};
    for (int j = 0; j < stride; j += Format<Real>::width) {
      const Lanes<Real> product = lanes_at(row + j) * lanes_at(x + j);
      sum += product;
      size += size_of_lanes(product);
    }
    found.w[i] = q[i] + sum_of_lanes(sum);
    terms[i] = size_of(q[i]) + sum_of_lanes(size);
  }
  measured(m, JudgeRules::degeneracy * eps<Real>, q, x, found.w, terms, work.right.data(), work.best.data(),
           work.ratio.data(), found.eta, found.rho, found.active, found.degenerate);
  if (!all_finite(x, m) || !all_finite(found.w, m))
    *found.eta = *found.rho = not_a_number<Real>;  // may be dropped above
}

// One problem of any size.
template <int S, class Real>
void findings(const Real* M, const Real* q, const Real* z, Workspace<Real>& work, const Found<Real>& found) {
  prepare<S>(M, work);
  copy_row<S>(z, work.m, work.stride, work.z.data());
  measure<S>(q, work.z.data(), work, found);
  write_flags(M, q, z, work.m, found);
}

// A group of problems as the judge sees them: the caller's numbers, and units that make rows comparable.
template <int m, class Real>
struct GroupJudge {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  V A[m][m], load[m], t[m], up[m], down[m];
  V w[m], eta, rho;
  K active[m], degenerate[m], whole;

  GroupJudge(const Real* M, const Real* q, int count) {
    gather<m>(M, q, count, A, load);
    K rows[m];
    const K plain = row_exponents_of_lanes<m, Real>(A, rows);
    for (int i = 0; i < m; ++i) {
      t[i] = A[i][i];
      up[i] = powers_of_two<Real>(rows[i]);
      down[i] = powers_of_two<Real>(-rows[i]);
    }
    for (int lane = 0; lane < count; ++lane) {
      if (plain[lane]) continue;
      int own[m];
      row_exponents(M + lane * m * m, m, own);
      for (int i = 0; i < m; ++i) {
        t[i][lane] = stiffness_of(M + lane * m * m + i * m, i, m);
        up[i][lane] = power_of_two<Real>(own[i]);
        down[i][lane] = power_of_two<Real>(-own[i]);
      }
    }
  }

  void measure(const V (&x)[m]) {
    V terms[m], point{};  // point: zero, or NaN
    for (int i = 0; i < m; ++i) {
      w[i] = load[i];
      terms[i] = size_of_lanes(load[i]);
      for (int j = 0; j < m; ++j) {
        const V product = A[i][j] * x[j];
        w[i] += product;
        terms[i] += size_of_lanes(product);
      }
      point += x[i] - x[i] + (w[i] - w[i]);
    }
    measured(m, all(JudgeRules::degeneracy * eps<Real>), load, x, w, terms, t, up, down, &eta, &rho, active,
             degenerate);
    whole = point == 0;
    eta = whole ? eta : all(not_a_number<Real>);  // comparisons above may have dropped it
    rho = whole ? rho : all(not_a_number<Real>);
  }

  void write(int count, const Found<Real>& found) const {
    V data{};
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) data += A[i][j] - A[i][j];
      data += load[i] - load[i];
    }
    const K flags = (data == 0 ? K{} + int(DATA_FINITE) : K{}) | (whole ? K{} + int(POINT_FINITE) : K{});
    write_lanes<m>(w, count, found.w);
    write_lanes<1>(&eta, count, found.eta);
    write_lanes<1>(&rho, count, found.rho);
    write_masks<m, Real>(active, count, found.active);
    write_masks<m, Real>(degenerate, count, found.degenerate);
    write_integers<Real>(flags, count, found.flags);
  }
};

// `count` problems of m contacts, up to one group.
template <int m, class Real>
void findings_of_group(const Real* M, const Real* q, const Real* z, int count, const Found<Real>& found) {
  Lanes<Real> x[m];
  GroupJudge<m, Real> judge(M, q, count);
  read_lanes<m>(z, count, x);
  judge.measure(x);
  judge.write(count, found);
}

// |K| |K^-1| in the largest-row-sum norm for the balanced K = M diag(held) + I diag(1 - held); infinite where K is
// singular up to rounding. Inversion in place with row pivoting.
template <int S, class Real>
Real condition(const Real* M, const bool* held, Workspace<Real>& work) {
  using V = Lanes<Real>;
  constexpr int W = Format<Real>::width;
  const int m = work.m, stride = S ? S : work.stride;
  Real *K = work.T.data(), *unit = work.unit.data(), *right = work.right.data(), *column = work.column.data();
  for (int j = 0; j < stride; ++j) right[j] = 0;
  for (int i = 0; i < m; ++i) {
    Real* row = K + i * stride;
    copy_row<S>(M + i * m, m, stride, row);
    for (int j = 0; j < m; ++j) row[j] = held[j] ? row[j] : Real(0);
    if (!held[i]) row[i] = 1;
    const V own = all(power_of_two<Real>(-exponent(largest_of(row, stride))));
    for (int j = 0; j < stride; j += W) {
      const V x = lanes_at(row + j) * own;
      put(x, row + j);
      put(larger_lanes(lanes_at(right + j), size_of_lanes(x)), right + j);
    }
  }
  for (int j = 0; j < stride; ++j) unit[j] = j < m ? power_of_two<Real>(-exponent(right[j])) : Real(0);
  const auto row_sum_norm = [&](bool balance, Real* most) {
    Real norm = 0;
    V largest{};
    for (int i = 0; i < m; ++i) {
      V sum{};
      for (int j = 0; j < stride; j += W) {
        const V x = balance ? lanes_at(K + i * stride + j) * lanes_at(unit + j) : lanes_at(K + i * stride + j);
        put(x, K + i * stride + j);
        sum += size_of_lanes(x);
        largest = larger_lanes(largest, size_of_lanes(x));
      }
      const Real total = sum_of_lanes(sum);
      norm = total <= norm ? norm : total;
    }
    *most = largest_lane(largest);
    return norm;
  };
  Real most;
  const Real norm = row_sum_norm(true, &most);
  const Real floor = JudgeRules::pivot_floor * m * eps<Real> * most;
  for (int s = 0; s < m; ++s) {
    int r = s;
    Real pivot = K[s * stride + s];
    if (!held[s]) {  // a unit column: rows of held pairs have nothing there
      Real* own = K + s * stride;
      const V per = all(1 / pivot);
      for (int j = 0; j < stride; j += W) put(lanes_at(own + j) * per, own + j);
      own[s] = 1 / pivot;
      continue;
    }
    for (int i = s + 1; i < m; ++i) {
      if (!held[i]) continue;
      const Real x = K[i * stride + s];
      r = size_of(x) > size_of(pivot) ? i : r;
      pivot = size_of(x) > size_of(pivot) ? x : pivot;
    }
    if (!(size_of(pivot) > floor)) return pivot == pivot ? infinity<Real> : not_a_number<Real>;
    Real* own = K + s * stride;
    if (r != s)  // this permutes the columns of the inverse, which a row sum does not see
      for (int j = 0; j < stride; j += W) {
        const V x = lanes_at(K + r * stride + j);
        put(lanes_at(own + j), K + r * stride + j);
        put(x, own + j);
      }
    const Real inverse = 1 / pivot;
    for (int i = 0; i < m; ++i) column[i] = K[i * stride + s];
    for (int j = 0; j < stride; ++j) right[j] = own[j] * inverse;
    for (int i = 0; i < m; ++i) {
      Real* row = K + i * stride;
      const V l = all(column[i]);
      for (int j = 0; j < stride; j += W) put(lanes_at(row + j) - l * lanes_at(right + j), row + j);
      row[s] = -column[i] * inverse;
    }
    for (int j = 0; j < stride; j += W) put(lanes_at(right + j), own + j);
    own[s] = inverse;
  }
  return norm * row_sum_norm(false, &most);
}

// A pivot below this part of its column is left to the code with row pivoting.
template <class Real>
constexpr Real SMALL_PIVOT = Real(1) / 1024;

// `count` conditions, up to one group; pivots as they come, as a P-matrix allows it.
template <int m, class Real>
void condition_lanes(const Real* M, const bool* held, int count, Workspace<Real>& work, Real* result) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  V A[m][m], load[m];
  K on[m];
  gather<m>(M, M, count, A, load);  // there is no load here
  const auto unit_of = [](V most) { return most > 0 ? powers_of_two<Real>(-exponents<Real>(most)) : V{} + 1; };
  for (int i = 0; i < m; ++i)
    for (int lane = 0; lane < Format<Real>::width; ++lane) on[i][lane] = -held[(lane < count ? lane : 0) * m + i];
  for (int i = 0; i < m; ++i) {
    V most{};
    for (int j = 0; j < m; ++j) {
      A[i][j] = on[j] ? A[i][j] : i == j ? V{} + 1 : V{};
      most = larger_lanes(most, size_of_lanes(A[i][j]));
    }
    const V unit = unit_of(most);
    for (int j = 0; j < m; ++j) A[i][j] *= unit;
  }
  K alone{};
  for (int j = 0; j < m; ++j) {
    V most{};
    for (int i = 0; i < m; ++i) most = larger_lanes(most, size_of_lanes(A[i][j]));
    const V unit = unit_of(most);
    for (int i = 0; i < m; ++i) A[i][j] *= unit;
    alone |= ~((most > 0) & (most < infinity<Real>));
  }
  const auto norm = [&] {
    V largest{};
    for (int i = 0; i < m; ++i) {
      V sum{};
      for (int j = 0; j < m; ++j) sum += size_of_lanes(A[i][j]);
      alone |= ~(sum == sum);
      largest = larger_lanes(largest, sum);
    }
    return largest;
  };
  const V before = norm();
  for (int s = 0; s < m; ++s) {
    V column[m], most{};
    for (int i = 0; i < m; ++i) {
      column[i] = A[i][s];
      most = larger_lanes(most, size_of_lanes(column[i]));
    }
    alone |= ~(size_of_lanes(column[s]) > SMALL_PIVOT<Real> * most);
    const V inverse = 1 / column[s];
    for (int j = 0; j < m; ++j) A[s][j] *= inverse;
    for (int i = 0; i < m; ++i)
      for (int j = 0; j < m && i != s; ++j) A[i][j] -= column[i] * A[s][j];
    for (int i = 0; i < m; ++i) A[i][s] = i == s ? inverse : -column[i] * inverse;
  }
  const V found = before * norm();
  for (int lane = 0; lane < count; ++lane)
    result[lane] = alone[lane] ? condition<0>(M + lane * m * m, held + lane * m, work) : found[lane];
}

}  // namespace jaxcontact
