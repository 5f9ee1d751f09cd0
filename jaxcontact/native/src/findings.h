// What the judge measures, from the caller's data: complementarity/residuals.py has the definitions, judge.py the
// verdict.
#pragma once

#include <memory>

#include "verdict.h"

namespace jaxcontact {

// A problem at a point z: w = M z + q, terms = |M||z| + |q|, t the stiffness of each row, up = 2^rows and down =
// 2^-rows the balanced units. N: lanes that hold a row of different problems each, or, with Real apart from it, that
// many rows of one problem; `rows` counts the N.
template <class N, class Real = N>
struct Point {
  int rows;
  const Real *q, *z, *w, *terms, *t, *up, *down;

  static constexpr bool alone = !std::is_same_v<N, Real>;

  static N at(const Real* x, int i) {
    if constexpr (alone)
      return lanes_at(x + i * Format<Real>::width);
    else
      return x[i];
  }
  static N most(N x) {
    if constexpr (alone)
      return all(largest_lane(x));
    else
      return x;
  }

  // z / Z and w / W over a common denominator: z times `z`, w times `w`, over `whole`, which is about one.
  struct Shares {
    N z, w, whole;

    Shares(N Z, N W) : z(per_power_of_two(Z)), w(per_power_of_two(W)) {
      const N unit_z = one_if_zero(Z * z), unit_w = one_if_zero(W * w);
      z *= unit_w, w *= unit_z, whole = unit_z * unit_w;
    }
  };

  JAXCONTACT_INLINE Shares balanced() const {
    N Z{}, W{};
    for (int i = 0; i < rows; ++i) {
      Z = larger(Z, size_of(at(z, i)) * at(down, i));
      W = larger(W, at(terms, i) * at(up, i));
    }
    return {most(Z), most(W)};
  }

  JAXCONTACT_INLINE void errors(N* eta, N* rho) const {
    N Z{}, W{}, load{}, miss{}, one{}, other{};
    for (int i = 0; i < rows; ++i) {
      Z = larger(Z, size_of(at(z, i)));
      W = larger(W, at(terms, i));
      load = larger(load, size_of(at(q, i)));
      miss = larger(miss, size_of(smaller(at(t, i) * at(z, i), at(w, i))));
    }
    *rho = most(miss) / one_if_zero(most(load));
    const Shares plain(most(Z), most(W)), fair = balanced();
    for (int i = 0; i < rows; ++i) {
      one = larger(one, size_of(smaller(at(z, i) * plain.z, at(w, i) * plain.w)));
      other = larger(other, size_of(smaller(at(z, i) * at(down, i) * fair.z, at(w, i) * at(up, i) * fair.w)));
    }
    one = most(one), other = most(other);
    const auto second = other * plain.whole > one * fair.whole;
    *eta = (second ? other : one) / (second ? fair.whole : plain.whole);
  }

  // to(i, active, degenerate) for each row.
  template <class To>
  void classes(To to) const {
    const Shares fair = balanced();
    const N zero = JudgeRules::degeneracy * eps<Number<N>> * fair.whole;
    for (int i = 0; i < rows; ++i) {
      const N c = at(z, i) * at(down, i) * fair.z, d = at(w, i) * at(up, i) * fair.w;
      to(i, (c > zero) & ((d <= zero) | (c > d)), (c <= zero) & (d <= zero));
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

template <class Real>
struct Classes {
  Real* w;
  bool *active, *degenerate;
};

template <class Real>
inline bool all_finite(const Real* x, int n) {
  constexpr int W = Format<Real>::width;
  Lanes<Real> sums{};  // zero, or NaN
  for (int i = 0; i < n; i += W) {
    const Lanes<Real> some = some_lanes_at(x + i, n - i);
    sums += some - some;
  }
  return sum_of_lanes(sums) == 0;
}

// One problem, its rows in the lanes.
template <class Real>
using Alone = Point<Lanes<Real>, Real>;

// It is made ready: its rows padded (work.M), its load (work.q), stiffness and balanced units of each row.
template <int S, class Real>
void prepare(const Real* M, const Real* q, Workspace<Real>& work) {
  using V = Lanes<Real>;
  const int m = work.m, stride = S ? S : work.stride;
  Real *t = work.right.data(), *up = work.best.data(), *down = work.ratio.data();
  for (int i = 0; i < stride; ++i) t[i] = i < m ? M[i * m + i] : 0;
  if (plain_units(M, m, stride, work.rows.data(), up)) {
    for (int i = 0; i < stride; i += Format<Real>::width) put(1 / one_if_zero(lanes_at(up + i)), down + i);
  } else {
    for (int i = 0; i < m; ++i) {
      t[i] = stiffness_of(M + i * m, i, m);
      up[i] = power_of_two<Real>(work.rows[i]);
      down[i] = power_of_two<Real>(-work.rows[i]);
    }
    for (int i = m; i < stride; ++i) up[i] = down[i] = 0;
  }
  for (int i = 0; i < m; ++i) copy_row<S>(M + i * m, m, stride, work.M.data() + i * stride);
  copy_row<S>(q, m, stride, work.q.data());
}

// That problem at a point x (padded); w is work.miss.
template <int S, class Real>
Alone<Real> at_point(const Real* x, Workspace<Real>& work) {
  using V = Lanes<Real>;
  constexpr int W = Format<Real>::width;
  const Real *M = work.M.data(), *q = work.q.data();
  Real *w = work.miss.data(), *terms = work.column.data();
  int groups = 0;
  for (int i = 0; i < work.m; i += W, ++groups) {
    put(lanes_at(q + i) + sums_of_rows<S>(M, x, work.stride, i, product_of<V>), w + i);
    put(size_of(lanes_at(q + i)) + sums_of_rows<S>(M, x, work.stride, i, size_of_product<V>), terms + i);
  }
  return {groups, q, x, w, terms, work.right.data(), work.best.data(), work.ratio.data()};
}

// Its eta and rho; whether the point is finite.
template <class Real>
bool measure(const Alone<Real>& point, const Found<Real>& found) {
  Lanes<Real> eta, rho;
  point.errors(&eta, &rho);
  const int padded = point.rows * Format<Real>::width;
  const bool whole = all_finite(point.z, padded) && all_finite(point.w, padded);
  *found.eta = whole ? eta[0] : not_a_number<Real>;  // comparisons may have dropped it
  *found.rho = whole ? rho[0] : not_a_number<Real>;
  return whole;
}

// Whether the equations of the mode of a point are not dependent up to rounding. The workspace that the point lies in
// is used up.
template <int S, class Real>
bool moderate(const Real* M, const Alone<Real>& point, Workspace<Real>& work) {
  constexpr int W = Format<Real>::width;
  const std::unique_ptr<bool[]> held(new bool[work.m]);
  point.classes([&](int group, Masks<Real> active, Masks<Real> degenerate) {
    for (int lane = 0, i = group * W; lane < W && i < work.m; ++lane, ++i) held[i] = active[lane] | degenerate[lane];
  });
  return condition<S>(M, held.get(), work) <= JudgeRules::condition<Real>;
}

// The same of a problem that is not prepared.
template <class Real>
__attribute__((noinline)) bool moderate(const Real* M, const Real* q, const Real* z, Workspace<Real>& work) {
  prepare<0>(M, q, work);
  copy_row<0>(z, work.m, work.stride, work.z.data());
  return moderate<0>(M, at_point<0>(work.z.data(), work), work);
}

// A final point, measured, and what is told of it.
template <int S, class Real>
void tell(const Real* M, const Alone<Real>& point, const Real* certificate, int outcome, Workspace<Real>& work,
          const Found<Real>& found) {
  const int m = work.m;
  const Real* identity = nullptr;
  int flags = measure(point, found) ? POINT_FINITE : 0;
  flags |= bounds_held(*found.eta, *found.rho);
  if (all_finite(M, m * m) && all_finite(point.q, m)) flags |= DATA_FINITE;
  if (!clear<Real>(*found.eta, *found.rho) && proves(M, identity, point.q, certificate, m, point.down, point.up))
    flags |= PROVED;
  if ((flags & (SMALL | TELLING)) == SMALL && moderate<S>(M, point, work)) flags |= MODERATE;
  *found.told = told(found.what, flags, outcome);
}

// One problem of any size.
template <int S, class Real>
void findings(const Real* M, const Real* q, const Real* z, const Real* certificate, int outcome, Workspace<Real>& work,
              const Found<Real>& found) {
  prepare<S>(M, q, work);
  copy_row<S>(z, work.m, work.stride, work.z.data());
  tell<S>(M, at_point<S>(work.z.data(), work), certificate, outcome, work, found);
}

template <int S, class Real>
void classes(const Real* M, const Real* q, const Real* z, Workspace<Real>& work, const Classes<Real>& to) {
  constexpr int W = Format<Real>::width;
  prepare<S>(M, q, work);
  copy_row<S>(z, work.m, work.stride, work.z.data());
  const Alone<Real> point = at_point<S>(work.z.data(), work);
  point.classes([&](int group, Masks<Real> active, Masks<Real> degenerate) {
    for (int lane = 0, i = group * W; lane < W && i < work.m; ++lane, ++i)
      to.active[i] = active[lane], to.degenerate[i] = degenerate[lane];
  });
  std::memcpy(to.w, point.w, sizeof(Real) * work.m);
}

// A group of problems as the judge sees them: the caller's numbers, and units that make rows comparable.
template <int m, class Real>
struct GroupJudge {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const Given<m, Real>& given;
  V t[m], up[m], down[m];
  V x[m], w[m], terms[m], eta, rho;
  K whole, sound;  // the point is finite, the data are

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

  JAXCONTACT_INLINE Point<V> at(const V (&z)[m]) {
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

  // Lanes where every row of the point of `at` misses by no more than EXACT eps of its own terms.
  JAXCONTACT_INLINE K settled() const {
    K all_rows = ~K{};
    for (int i = 0; i < m; ++i) {
      const V allowed = EXACT * eps<Real> * terms[i];
      all_rows &= (w[i] >= -allowed) & ((x[i] <= 0) | (w[i] <= allowed));
    }
    return all_rows;
  }

  void measure(const V (&z)[m]) { measure(at(z)); }

  void measure(const Real* z) {
    V own[m];
    read_lanes<m>(z, given.count, own);
    measure(own);
  }

  JAXCONTACT_INLINE void measure(const Point<V>& at_z) {
    at_z.errors(&eta, &rho);
    V sum{}, point{}, data{};
    for (const V& part : terms) sum += part;
    sound = whole = sum - sum == 0;  // no number is lost in a sum of sizes
    if (!any_lane<Real>(~sound)) return;
    for (int i = 0; i < m; ++i) {
      point += x[i] - x[i] + (w[i] - w[i]);  // zero, or NaN
      data += given.load[i] - given.load[i];
      for (int j = 0; j < m; ++j) data += given.A[i][j] - given.A[i][j];
    }
    whole = point == 0, sound = data == 0;
    eta = whole ? eta : all(not_a_number<Real>);  // comparisons above may have dropped it
    rho = whole ? rho : all(not_a_number<Real>);
  }

  // What was measured last, of the points z; where a lane is not clear, seldom, it is looked at by itself.
  void write(const Ended<Real>& ended, const Real* z, Workspace<Real>& work, const Found<Real>& found) const {
    const int count = given.count;
    write_lanes<1>(&eta, count, found.eta);
    write_lanes<1>(&rho, count, found.rho);
    const K flags = (sound & int(DATA_FINITE)) | (whole & int(POINT_FINITE)) | bounds_held<Real>(eta, rho);
    K tells = found.what == Tells::FLAGS ? flags : found.what == Tells::OUTCOME ? ended.outcome : K{} + int(SOLVED);
    const K open = ~(clear<Real>(eta, rho) & sound & whole);
    if (found.what != Tells::OUTCOME && any_lane<Real>(open))
      for (int lane = 0; lane < count; ++lane)
        if (open[lane])
          tells[lane] = told(found.what, int(flags[lane]) | seen(ended, z, lane, work), ended.outcome[lane]);
    write_integers<Real>(tells, count, found.told);
  }

  // PROVED and MODERATE of one lane.
  __attribute__((noinline)) int seen(const Ended<Real>& ended, const Real* z, int lane, Workspace<Real>& work) const {
    const Real *M = given.M + lane * m * m, *q = given.q + lane * m, *identity = nullptr;
    const bool small = eta[lane] <= JudgeRules::backward_error<Real>;
    if (clear<Real>(eta[lane], rho[lane])) return 0;
    int flags = small && moderate(M, q, z + lane * m, work) ? MODERATE : 0;
    if (!ended.certificates) return flags;
    Real unit_z[m], unit_w[m];
    for (int i = 0; i < m; ++i) unit_z[i] = down[i][lane], unit_w[i] = up[i][lane];
    return proves(M, identity, q, ended.certificates + lane * m, m, unit_z, unit_w) ? flags | PROVED : flags;
  }
};

// z of a group in balanced units is cut to z >= 0, written and measured. Where lanes are not settled, seldom,
// refine(them) corrects z; the lanes where it is still not close are returned, by `refine` too.
template <int m, class Real, class Refine>
inline Masks<Real> conclude(const Group<m, Real>& group, GroupJudge<m, Real>& judge, Lanes<Real> (&z)[m], Refine refine,
                            Real* to) {
  Lanes<Real> x[m];
  const auto point = [&] {
    for (int i = 0; i < m; ++i) x[i] = cut(z[i]) * group.unit[i] * group.whole;
    return judge.at(x);
  };
  Point<Lanes<Real>> found = point();
  Masks<Real> open = ~judge.settled();
  if (any_lane<Real>(open)) {
    open = refine(open);
    found = point();
  }
  judge.measure(found);
  write_lanes<m>(x, judge.given.count, to);
  return open;
}

template <int m, class Real>
void classes_of_group(const Given<m, Real>& given, const Real* z, const Classes<Real>& to) {
  Lanes<Real> x[m];
  Masks<Real> active[m], degenerate[m];
  GroupJudge<m, Real> judge(given);
  read_lanes<m>(z, given.count, x);
  judge.at(x).classes([&](int i, Masks<Real> a, Masks<Real> d) { active[i] = a, degenerate[i] = d; });
  write_lanes<m>(judge.w, given.count, to.w);
  write_masks<m, Real>(active, given.count, to.active);
  write_masks<m, Real>(degenerate, given.count, to.degenerate);
}

}  // namespace jaxcontact
