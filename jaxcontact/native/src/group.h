// Problems of few contacts, one per lane: an instruction works on a whole group of them.
#pragma once

#include "tableau.h"

namespace jaxcontact {

// Up to this many contacts a group of problems fits the nearest cache and its loops are written out.
constexpr int GROUPED = 8;

// Balanced entries and load; unit and whole take z back to the caller: z_i unit_i whole.
template <int m, class Real>
struct Group {
  Lanes<Real> M[m][m], q[m], unit[m], whole;
};

// Whether n numbers per problem are whole groups of lanes, or a power of two that divides one.
template <int n, class Real>
constexpr bool REGULAR = n <= Format<Real>::width ? (n & (n - 1)) == 0 : n % Format<Real>::width == 0;

// n numbers of each problem, lane by lane; lanes beyond `count` repeat the first problem.
template <int n, class Real>
JAXCONTACT_INLINE void read_lanes(const Real* from, int count, Lanes<Real>* to) {
  constexpr int W = Format<Real>::width, block = n < W ? n : W;
  if (REGULAR<n, Real> && count == W) {
    for (int start = 0; start < n; start += block) {
      for (int k = 0; k < block; ++k) to[start + k] = lanes_at(from + (n < W ? k * W : k * n + start));
      by_number<REGULAR<n, Real> ? block : 1>(to + start);
    }
    return;
  }
  for (int lane = 0; lane < W; ++lane)
    for (int j = 0; j < n; ++j) to[j][lane] = from[(lane < count ? lane : 0) * n + j];
}

// n numbers of each of the first `count` problems, written problem by problem.
template <int n, class Real>
JAXCONTACT_INLINE void write_lanes(const Lanes<Real>* from, int count, Real* to) {
  constexpr int W = Format<Real>::width;
  if (REGULAR<n, Real> && n <= W && count == W) {
    Lanes<Real> x[n];
    for (int j = 0; j < n; ++j) x[j] = from[j];
    by_problem<REGULAR<n, Real> && n <= W ? n : 1>(x);
    for (int k = 0; k < n; ++k) put(x[k], to + k * W);
    return;
  }
  for (int j = 0; j < n; ++j)
    for (int lane = 0; lane < count; ++lane) to[lane * n + j] = from[j][lane];
}

// The same for truth values.
template <int n, class Real>
inline void write_masks(const Masks<Real>* from, int count, bool* to) {
  using Word = typename Format<Real>::Word;
  constexpr int bytes = sizeof(Word);
  for (int start = 0; start < n; start += bytes) {
    const int here = n - start < bytes ? n - start : bytes;
    Masks<Real> packed{};
    for (int j = 0; j < here; ++j) packed |= (from[start + j] & 1) << 8 * j;
    for (int lane = 0; lane < count; ++lane) {
      const Word word = packed[lane];
      std::memcpy(to + lane * n + start, &word, here);
    }
  }
}

// The numbers of a group as they came, and the exponents of `row_exponents` where the diagonal is positive and finite;
// where it is not, `plain` is false.
template <int m, class Real>
struct Given {
  const Real *M, *q;
  int count;
  Lanes<Real> A[m][m], load[m];
  Masks<Real> rows[m], plain = ~Masks<Real>{};

  JAXCONTACT_INLINE Given(const Real* M, const Real* q, int count) : M(M), q(q), count(count) {
    read_lanes<m * m>(M, count, &A[0][0]);
    read_lanes<m>(q, count, load);
    for (int i = 0; i < m; ++i) {
      plain &= (A[i][i] > 0) & (A[i][i] < infinity<Real>);
      rows[i] = exponents<Real>(A[i][i]);
    }
    const Masks<Real> odd = rows[0] & 1;
    for (int i = 0; i < m; ++i) rows[i] = -halves<Real>(rows[i] - odd);
  }
};

// One lane balanced with care by the code for single problems.
template <int m, class Real>
__attribute__((noinline)) void balance_lane(const Real* M, const Real* q, int lane, Group<m, Real>& group) {
  constexpr int stride = padded<Real>(m);
  int rows[m];
  alignas(64) Real unit[stride], T[m * stride], load[stride];
  const Units units = scaled<stride>(M, q, m, stride, rows, unit, T, load);
  group.whole[lane] = 1;
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) group.M[i][j][lane] = T[i * stride + j];
    group.q[i][lane] = load[i];
    group.unit[i][lane] = power_of_two<Real>(units.of_z(i));
  }
}

// The problems of a group, balanced by powers of two.
template <int m, class Real>
JAXCONTACT_INLINE void load(const Given<m, Real>& given, Group<m, Real>& group) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  constexpr int room = ROOM<Real>;
  K plain = given.plain;
  V largest{}, heaviest{};
  for (int i = 0; i < m; ++i) {
    plain &= (given.rows[i] < room) & (given.rows[i] > -room);
    group.unit[i] = powers_of_two<Real>(given.rows[i]);
  }
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) {
      group.M[i][j] = given.A[i][j] * group.unit[i] * group.unit[j];
      largest = larger(largest, size_of(group.M[i][j]));
      plain &= group.M[i][j] == group.M[i][j];
    }
    group.q[i] = given.load[i] * group.unit[i];
    heaviest = larger(heaviest, size_of(group.q[i]));
    plain &= group.q[i] == group.q[i];
  }
  const K size_M = exponents<Real>(largest), size_q = heaviest > 0 ? exponents<Real>(heaviest) : K{};
  plain &= (size_M < room) & (size_M > -room) & (size_q < room) & (size_q > -room);
  const V per_M = powers_of_two<Real>(-size_M), per_q = powers_of_two<Real>(-size_q);
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) group.M[i][j] *= per_M;
    group.q[i] *= per_q;
  }
  group.whole = powers_of_two<Real>(size_q - size_M);
  if (!any_lane<Real>(~plain)) return;
  for (int lane = 0; lane < Format<Real>::width; ++lane) {
    const int from = lane < given.count ? lane : 0;
    if (!plain[lane]) balance_lane<m>(given.M + from * m * m, given.q + from * m, lane, group);
  }
}

// miss = M z + q; the return value is max |min(z, miss)|, NaN stays.
template <int m, class Real>
inline Lanes<Real> violation_of_lanes(const Group<m, Real>& group, const Lanes<Real> (&z)[m], Lanes<Real> (&miss)[m]) {
  Lanes<Real> most{};
  for (int i = 0; i < m; ++i) {
    miss[i] = group.q[i];
    for (int j = 0; j < m; ++j) miss[i] += group.M[i][j] * z[j];
    const Lanes<Real> size = size_of(smaller(z[i], miss[i]));
    most = size <= most ? most : size;
  }
  return most;
}

template <class V>
inline V cut(V x) {
  return x < 0 ? V{} : x;
}

// A row misses by no more than ENOUGH eps of the largest terms: a quarter of what the judge allows.
constexpr int ENOUGH = 64;

// `refine` of tableau.h for the open lanes of a group; those where it is not close are returned. correct(miss, z):
// subtract from z what the bases say of the miss.
template <int m, class Real, class Correct>
inline Masks<Real> refine_lanes(const Group<m, Real>& group, Masks<Real> open, Lanes<Real> (&z)[m], int corrections,
                                Correct correct) {
  using V = Lanes<Real>;
  V best[m], miss[m], held[m];
  for (int i = 0; i < m; ++i) best[i] = cut(z[i]);
  V least = violation_of_lanes(group, best, miss);
  for (int k = 0; k < corrections; ++k) {
    violation_of_lanes(group, z, miss);
    correct(miss, z);
    for (int i = 0; i < m; ++i) held[i] = cut(z[i]);
    const V found = violation_of_lanes(group, held, miss);
    const Masks<Real> better = open & (found < least);  // what is settled stays as it is, in any company
    for (int i = 0; i < m; ++i) best[i] = better ? held[i] : best[i];
    least = better ? found : least;
  }
  for (int i = 0; i < m; ++i) z[i] = best[i];
  const Masks<Real> doubtful = open & ~(least <= ENOUGH * eps<Real>);
  if (!any_lane<Real>(doubtful)) return doubtful;
  V size{};
  for (int i = 0; i < m; ++i) {
    V terms = size_of(group.q[i]);
    for (int j = 0; j < m; ++j) terms += size_of(group.M[i][j] * z[j]);
    size = larger(size, terms);
  }
  return doubtful & ~(least <= ENOUGH * eps<Real> * size);
}

// `hopeless_row` of every problem; written, and true, only if there is one.
template <int m, class Real>
inline bool hopeless_rows(const Given<m, Real>& given, Real* certificate) {
  Masks<Real> any{};
  for (int i = 0; i < m; ++i) {
    Masks<Real> hopeless = given.load[i] < 0;
    for (int j = 0; j < m; ++j) hopeless &= given.A[i][j] <= 0;
    any |= hopeless;
  }
  if (!any_lane<Real>(any)) return false;
  for (int lane = 0; lane < given.count; ++lane)
    hopeless_row(given.M + lane * m * m, given.q + lane * m, m, certificate + lane * m);
  return true;
}

}  // namespace jaxcontact
