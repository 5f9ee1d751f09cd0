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

}  // namespace jaxcontact
