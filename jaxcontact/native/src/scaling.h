// Balancing by powers of two, as in complementarity/scaling.py: the same exponents, so the same digits.
#pragma once

#include "arithmetic.h"

namespace jaxcontact {

// The exponents of one problem. M_scaled = 2^(rows_i + rows_j - size_M) M and q_scaled = 2^(rows_i - size_q) q.
struct Units {
  int* rows;
  int size_M, size_q;
  bool moderate;  // all 2^rows are far from the ends of the format

  // What takes z of the scaled problem to the caller's.
  int of_z(int i) const { return rows[i] + size_q - size_M; }
};

inline int one_or_both(bool across, bool down, int e_across, int e_down) {
  return (across ? e_across : e_down) + (down ? e_down : e_across);
}

// Row exponents where some M_ii <= 0: the largest entries of row and column stand in, first any, then those that couple
// to rows with a stiffness of their own, in their units.
template <class Real>
void row_exponents_without_diagonal(const Real* M, int m, int* rows) {
  int leader = 0;
  for (int i = m - 1; i >= 0; --i)
    if (M[i * m + i] > 0) leader = i;
  const auto sides = [&](int i, const auto& unit, Real* across, Real* down) {
    *across = *down = 0;
    for (int j = 0; j < m; ++j) {
      *across = larger(*across, size_of(M[i * m + j] * unit(j)));
      *down = larger(*down, size_of(M[j * m + i] * unit(j)));
    }
  };
  const auto size = [&](int i) {
    if (M[i * m + i] > 0) return exponent(M[i * m + i]);
    Real across, down;
    sides(i, [](int) { return Real(1); }, &across, &down);
    return one_or_both(across > 0, down > 0, exponent(across), exponent(down)) >> 1;
  };
  const int odd = size(leader) & 1;
  for (int i = 0; i < m; ++i) rows[i] = -((size(i) - odd) >> 1);
  for (int i = 0; i < m; ++i) {
    if (M[i * m + i] > 0) continue;
    Real across, down;
    sides(i, [&](int j) { return M[j * m + j] > 0 ? power_of_two<Real>(rows[j]) : Real(0); }, &across, &down);
    if (across > 0 || down > 0)
      rows[i] = -((one_or_both(across > 0, down > 0, exponent(across), exponent(down)) - 2 * odd) >> 1);
  }
}

template <class Real>
inline void row_exponents(const Real* M, int m, int* rows) {
  bool positive = true;
  for (int i = 0; i < m; ++i) positive &= M[i * m + i] > 0;
  if (!positive) return row_exponents_without_diagonal(M, m, rows);
  const int odd = exponent(M[0]) & 1;
  for (int i = 0; i < m; ++i) rows[i] = -((exponent(M[i * m + i]) - odd) >> 1);
}

// Row i of a matrix copied to whole groups of lanes, the rest filled with zeros.
template <int S, class Real>
inline void copy_row(const Real* from, int m, int stride_, Real* to) {
  const int stride = S ? S : stride_;
  if (m == stride) {
    for (int j = 0; j < stride; ++j) to[j] = from[j];
  } else {
    for (int j = 0; j < m; ++j) to[j] = from[j];
    for (int j = m; j < stride; ++j) to[j] = 0;
  }
}

// The exponents of largest entries found without forming numbers that might overflow, and the factors in two steps.
template <class Real>
void scaled_with_care(const Real* M, int m, int stride, Units& units, Real* T) {
  bool any = false;
  units.size_M = 0;
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) {
      const Real x = M[i * m + j];
      if (x == 0 || !is_finite(x)) continue;
      const int e = exponent(x) + units.rows[i] + units.rows[j];
      units.size_M = any && units.size_M > e ? units.size_M : e;
      any = true;
    }
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j)
      T[i * stride + j] = times_power_of_two(M[i * m + j], units.rows[i] + units.rows[j] - units.size_M);
}

// Fill T (m rows of whole groups of lanes, padded with zeros) and q_scaled (one row) from the caller's data, and unit
// (one row) with 2^rows.
template <int S, class Real>
inline Units scaled(const Real* M, const Real* q, int m, int stride_, int* rows, Real* unit, Real* T, Real* q_scaled) {
  const int stride = S ? S : stride_;
  constexpr int W = Format<Real>::width;
  Units units{rows, 0, 0, true};
  row_exponents(M, m, rows);
  units.moderate = true;
  for (int i = 0; i < m; ++i) {
    units.moderate &= rows[i] < Format<Real>::bias / 4 && -rows[i] < Format<Real>::bias / 4;
    unit[i] = power_of_two<Real>(rows[i]);
  }
  for (int i = m; i < stride; ++i) unit[i] = 0;
  Lanes<Real> most{};
  for (int i = 0; i < m; ++i) {
    Real* row = T + i * stride;
    copy_row<S>(M + i * m, m, stride, row);
    const Lanes<Real> own = all(unit[i]);
    for (int j = 0; j < stride; j += W) {
      const Lanes<Real> x = lanes_at(row + j) * own * lanes_at(unit + j);
      put(x, row + j);
      most = larger(most, size_of(x));
    }
  }
  const Real largest = largest_lane(most);
  if (!units.moderate || !(largest > 0) || !is_finite(largest)) {
    scaled_with_care(M, m, stride, units, T);
  } else {
    units.size_M = exponent(largest);
    const Lanes<Real> whole = all(power_of_two<Real>(-units.size_M));
    for (int j = 0; j < m * stride; j += W) put(lanes_at(T + j) * whole, T + j);
  }
  bool any = false;
  for (int i = 0; i < m; ++i) {
    if (q[i] == 0 || !is_finite(q[i])) continue;
    const int e = exponent(q[i]) + rows[i];
    units.size_q = any && units.size_q > e ? units.size_q : e;
    any = true;
  }
  for (int i = 0; i < m; ++i) q_scaled[i] = times_power_of_two(q[i], rows[i] - units.size_q);
  for (int i = m; i < stride; ++i) q_scaled[i] = 0;
  return units;
}

}  // namespace jaxcontact
