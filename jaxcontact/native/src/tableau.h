// A dense tableau, basic = T nonbasic + values, and its one operation: the exchange of a basic with a nonbasic
// variable.
#pragma once

#include <new>
#include <vector>

#include "scaling.h"

namespace jaxcontact {

// How a path ended, and what is said of a problem, as in complementarity/status.py.
enum Status : int {
  SOLVED = 0,
  RAY = 1,
  INFEASIBLE = 2,
  MAX_STEPS = 3,
  INACCURATE = 4,
  BAD_INPUT = 5,
  REDUNDANT = 6,
  ILL_CONDITIONED = 8,
  NO_SOLUTION = 9
};

// Memory that begins with a cache line, so that no group of lanes lies across two.
template <class T>
struct Aligned {
  using value_type = T;
  static constexpr std::align_val_t line{64};
  Aligned() = default;
  template <class U>
  Aligned(const Aligned<U>&) {}
  T* allocate(size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), line)); }
  void deallocate(T* p, size_t) { ::operator delete(p, line); }
  bool operator==(const Aligned&) const { return true; }
  bool operator!=(const Aligned&) const { return false; }
};

// Everything one thread needs for problems of m contacts; rows are padded to whole groups of lanes.
template <class Real>
struct Workspace {
  int m, stride;
  std::vector<Real, Aligned<Real>> M, T, q, values, column, right, z, best, miss, ratio, unit, certificate;
  std::vector<int> rows, basic, nonbasic;
  std::vector<typename Format<Real>::Word, Aligned<typename Format<Real>::Word>> active,
      barred;  // 0 or -1, whole groups of lanes
  std::vector<char> tied;

  // extra: columns of T beyond those of M.
  explicit Workspace(int m, int extra = 0) : m(m), stride(padded<Real>(m + extra)) {
    for (auto* x : {&M, &T}) x->assign(size_t(padded<Real>(m)) * stride, 0);
    for (auto* x : {&q, &values, &column, &right, &z, &best, &miss, &ratio, &unit}) x->assign(stride, 0);
    certificate.assign(size_t(m) * Format<Real>::width, 0);  // of a whole group
    rows.assign(m, 0);
    basic.assign(m, 0);
    nonbasic.assign(m + 1, 0);
    for (auto* x : {&active, &barred}) x->assign(stride, 0);
    tied.assign(stride, 0);
  }
};

// Row r against column s with pivot T_rs: one rank-one update, with whole groups of lanes only. A group read right
// behind the write of one of its numbers would wait for it. S: the row length where the compiler may know it, else 0.
template <int S, class Real>
inline void exchange(Real* __restrict T, Real* __restrict values, Real* __restrict right, int m, int stride_, int r,
                     int s) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  constexpr int W = Format<Real>::width;
  const int stride = S ? S : stride_;
  const Real *across = T + r * stride, inverse = 1 / across[s];
  const V step = all(values[r] * inverse);
  for (int i = 0; i < m; i += W) {
    const K here = lane_numbers<Real>() + i == r;
    const V left = here ? V{} + 1 : strided<Real>(T + i * stride + s, stride);
    put((here ? V{} : lanes_at(values + i)) - left * step, values + i);
  }
  for (int j = 0; j < stride; j += W)
    put(lane_numbers<Real>() + j == s ? all(-inverse) : lanes_at(across + j) * all(inverse), right + j);
  for (int i = 0; i < m; ++i) {
    Real* row = T + i * stride;
    const V left = all(row[s]);
    for (int j = 0; j < stride; j += W)
      put((lane_numbers<Real>() + j == s ? V{} : lanes_at(row + j)) - left * lanes_at(right + j), row + j);
  }
  for (int j = 0; j < stride; j += W) put(-lanes_at(right + j), T + r * stride + j);
}

// For the rows from i on, one to a lane: f of each group of a row, and of z there, summed.
template <int S, class Real, class Term>
inline Lanes<Real> sums_of_rows(const Real* M, const Real* z, int stride_, int i, Term term) {
  constexpr int W = Format<Real>::width;
  const int stride = S ? S : stride_;
  Lanes<Real> sums[W];
  for (int k = 0; k < W; ++k) {
    sums[k] = Lanes<Real>{};
    for (int j = 0; j < stride; j += W) sums[k] += term(lanes_at(M + (i + k) * stride + j), lanes_at(z + j));
  }
  return sums_of_lanes<W>(sums);
}

template <class V>
inline V product_of(V a, V b) {
  return a * b;
}

template <class V>
inline V size_of_product(V a, V b) {
  return size_of(a * b);
}

// miss = M z + q, rows of padded length; the return value is max |min(z, miss)|, NaN if one entry is.
template <int S, class Real>
inline Real violation(const Real* __restrict M, const Real* __restrict q, const Real* __restrict z,
                      Real* __restrict miss, int m, int stride_) {
  using V = Lanes<Real>;
  V most{}, lost{};
  for (int i = 0; i < m; i += Format<Real>::width) {
    const V total = lanes_at(q + i) + sums_of_rows<S>(M, z, stride_, i, product_of<V>);
    put(total, miss + i);
    most = larger(most, size_of(smaller(lanes_at(z + i), total)));
    lost += total - total;  // zero, or NaN
  }
  return largest_lane(most) + sum_of_lanes(lost);
}

// z of the caller.
template <class Real>
inline void unscale(const Real* x, const Real* unit, const Units& units, int m, Real* z) {
  const int whole = units.size_q - units.size_M;
  if (units.moderate && whole < ROOM<Real> && -whole < ROOM<Real>) {
    const Real factor = power_of_two<Real>(whole);
    for (int i = 0; i < m; ++i) z[i] = x[i] * unit[i] * factor;
  } else {
    for (int i = 0; i < m; ++i) z[i] = times_power_of_two(x[i], units.of_z(i));
  }
}

// Correction steps with the final basis, as pivoting.REFINEMENTS.
constexpr int REFINEMENTS = 2;

// A row misses by no more than EXACT eps of its own terms: then nothing is left to correct. The violation does not say
// so: it is that of the worst row, and a row of small terms may lose digits behind it.
constexpr int EXACT = 8;

// Whether every row of M z + q, with terms of that size, is settled: zero where z is not, else not negative.
template <int S, class Real>
inline bool settled(const Real* __restrict M, const Real* __restrict q, const Real* __restrict z,
                    const Real* __restrict miss, int m, int stride_) {
  using V = Lanes<Real>;
  Masks<Real> open{};
  for (int i = 0; i < m; i += Format<Real>::width) {
    const V terms = size_of(lanes_at(q + i)) + sums_of_rows<S>(M, z, stride_, i, size_of_product<V>);
    const V allowed = EXACT * eps<Real> * terms, x = lanes_at(z + i), left = lanes_at(miss + i);
    open |= ~((left >= -allowed) & ((x <= 0) | (left <= allowed)));
  }
  return !any_lane<Real>(open);
}

// z (padded) replaced by the best of itself and its corrections, negative entries cut to zero before each is measured.
// correct(miss, z): subtract from z what the basis says of the miss.
template <int S, class Real, class Correct>
inline void refine(Workspace<Real>& work, Correct correct) {
  const int m = work.m, stride = S ? S : work.stride;
  Real *z = work.z.data(), *best = work.best.data(), *held = work.ratio.data(), *miss = work.miss.data();
  const Real *M = work.M.data(), *q = work.q.data();
  for (int i = 0; i < stride; ++i) best[i] = i < m && !(z[i] < 0) ? z[i] : 0;
  Real least = violation<S>(M, q, best, miss, m, stride);
  const int corrections = settled<S>(M, q, best, miss, m, stride) ? 0 : REFINEMENTS;
  for (int k = 0; k < corrections; ++k) {
    violation<S>(M, q, z, miss, m, stride);
    correct(miss, z);
    for (int i = 0; i < stride; ++i) held[i] = i < m && !(z[i] < 0) ? z[i] : 0;
    const Real size = violation<S>(M, q, held, miss, m, stride);
    if (!(size < least)) continue;
    least = size;
    for (int i = 0; i < m; ++i) best[i] = held[i];
  }
  for (int i = 0; i < m; ++i) z[i] = best[i];
}

// -e_i for the first violated row without positive entries, as of two immovable bodies; or zeros.
template <class Real>
inline void hopeless_row(const Real* M, const Real* q, int m, Real* certificate) {
  bool taken = false;
  for (int i = 0; i < m; ++i) {
    bool hopeless = q[i] < 0 && !taken;
    for (int j = 0; j < m && hopeless; ++j) hopeless = M[i * m + j] <= 0;
    certificate[i] = hopeless ? -1 : 0;
    taken |= hopeless;
  }
}

}  // namespace jaxcontact
