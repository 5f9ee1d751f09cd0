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

// Those exponents stay this far from the ends of the format where a product of few such units needs no care.
template <class Real>
constexpr int ROOM = Format<Real>::bias / 4;

// Row exponents, and 2^rows in whole groups with zeros behind; false, with exponents only, where they need care.
template <class Real>
inline bool plain_units(const Real* M, int m, int stride, int* rows, Real* unit) {
  constexpr int W = Format<Real>::width;
  for (int i = 0; i < stride; ++i) unit[i] = i < m ? M[i * m + i] : 1;
  const int odd = exponent(M[0]) & 1;
  Masks<Real> plain = ~Masks<Real>{};
  for (int i = 0; i < stride; i += W) {
    const Lanes<Real> own = lanes_at(unit + i);
    const Masks<Real> k = -halves<Real>(exponents<Real>(own) - odd);
    plain &= (own > 0) & (own < infinity<Real>)&(k < ROOM<Real>)&(k > -ROOM<Real>);
    put(lane_numbers<Real>() + i < m ? powers_of_two<Real>(k) : Lanes<Real>{}, unit + i);
    write_integers<Real>(k, m - i < W ? m - i : W, rows + i);
  }
  if (!any_lane<Real>(~plain)) return true;
  row_exponents(M, m, rows);
  return false;
}

// Row i of a matrix copied to whole groups of lanes, the rest filled with zeros.
template <int S, class Real>
inline void copy_row(const Real* from, int m, int stride_, Real* to) {
  const int stride = S ? S : stride_;
  for (int j = 0; j < stride; j += Format<Real>::width) put(some_lanes_at(from + j, m - j), to + j);
}

// T and q_scaled where numbers might overflow: the exponents of the largest entries first, then factors in two steps.
template <class Real>
void scaled_with_care(const Real* M, const Real* q, int m, int stride, Units& units, Real* T, Real* q_scaled) {
  const int* rows = units.rows;
  const auto exponent_of_largest = [](int n, auto number, auto shift) {
    bool any = false;
    int most = 0;
    for (int k = 0; k < n; ++k) {
      if (number(k) == 0 || !is_finite(number(k))) continue;
      const int e = exponent(number(k)) + shift(k);
      most = any && most > e ? most : e;
      any = true;
    }
    return most;
  };
  const auto both = [rows, m](int k) { return rows[k / m] + rows[k % m]; };
  units.size_M = exponent_of_largest(m * m, [M](int k) { return M[k]; }, both);
  units.size_q = exponent_of_largest(m, [q](int i) { return q[i]; }, [rows](int i) { return rows[i]; });
  for (int k = 0; k < m * m; ++k) T[k / m * stride + k % m] = times_power_of_two(M[k], both(k) - units.size_M);
  for (int i = 0; i < m; ++i) q_scaled[i] = times_power_of_two(q[i], rows[i] - units.size_q);
}

// Fill T (m rows of whole groups of lanes, padded with zeros) and q_scaled (one row) from the caller's data, and unit
// (one row) with 2^rows.
template <int S, class Real>
inline Units scaled(const Real* M, const Real* q, int m, int stride_, int* rows, Real* unit, Real* T, Real* q_scaled) {
  using V = Lanes<Real>;
  constexpr int W = Format<Real>::width;
  const int stride = S ? S : stride_;
  Units units{rows, 0, 0, plain_units(M, m, stride, rows, unit)};
  if (!units.moderate)
    for (int i = 0; i < m; ++i) unit[i] = power_of_two<Real>(rows[i]);
  V most{}, heaviest{};
  for (int i = 0; i < m; ++i) {
    Real* row = T + i * stride;
    const V own = all(unit[i]);
    for (int j = 0; j < stride; j += W) {
      const V x = some_lanes_at(M + i * m + j, m - j) * own * lanes_at(unit + j);
      put(x, row + j);
      most = larger(most, size_of(x));
    }
  }
  for (int j = 0; j < stride; j += W) {
    const V x = some_lanes_at(q + j, m - j) * lanes_at(unit + j);
    put(x, q_scaled + j);
    heaviest = larger(heaviest, size_of(x));
  }
  const Real largest = largest_lane(most), load = largest_lane(heaviest);
  const auto plain = [](Real x) { return exponent(x) < ROOM<Real> && exponent(x) > -ROOM<Real>; };
  if (!units.moderate || !(largest > 0 && is_finite(largest)) || !(is_finite(load) && plain(load))) {
    scaled_with_care(M, q, m, stride, units, T, q_scaled);
    return units;
  }
  units.size_M = exponent(largest), units.size_q = exponent(load);
  const V per_M = all(power_of_two<Real>(-units.size_M)), per_q = all(power_of_two<Real>(-units.size_q));
  for (int j = 0; j < m * stride; j += W) put(lanes_at(T + j) * per_M, T + j);
  for (int j = 0; j < stride; j += W) put(lanes_at(q_scaled + j) * per_q, q_scaled + j);
  return units;
}

}  // namespace jaxcontact
