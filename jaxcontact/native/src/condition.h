// The condition number of the equations of a mode, as in complementarity/inverse.py.
#pragma once

#include "group.h"
#include "proof.h"

namespace jaxcontact {

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
      put(larger(lanes_at(right + j), size_of(x)), right + j);
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
        sum += size_of(x);
        largest = larger(largest, size_of(x));
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
    if (r != s)  // this permutes the columns of the inverse, which a row sum
                 // does not see
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
  V A[m][m];
  K on[m];
  read_lanes<m * m>(M, count, &A[0][0]);
  const auto unit_of = [](V most) { return most > 0 ? powers_of_two<Real>(-exponents<Real>(most)) : V{} + 1; };
  for (int i = 0; i < m; ++i)
    for (int lane = 0; lane < Format<Real>::width; ++lane) on[i][lane] = -held[(lane < count ? lane : 0) * m + i];
  for (int i = 0; i < m; ++i) {
    V most{};
    for (int j = 0; j < m; ++j) {
      A[i][j] = on[j] ? A[i][j] : i == j ? V{} + 1 : V{};
      most = larger(most, size_of(A[i][j]));
    }
    const V unit = unit_of(most);
    for (int j = 0; j < m; ++j) A[i][j] *= unit;
  }
  K alone{};
  for (int j = 0; j < m; ++j) {
    V most{};
    for (int i = 0; i < m; ++i) most = larger(most, size_of(A[i][j]));
    const V unit = unit_of(most);
    for (int i = 0; i < m; ++i) A[i][j] *= unit;
    alone |= ~((most > 0) & (most < infinity<Real>));
  }
  const auto norm = [&] {
    V largest{};
    for (int i = 0; i < m; ++i) {
      V sum{};
      for (int j = 0; j < m; ++j) sum += size_of(A[i][j]);
      alone |= ~(sum == sum);
      largest = larger(largest, sum);
    }
    return largest;
  };
  const V before = norm();
  for (int s = 0; s < m; ++s) {
    V column[m], most{};
    for (int i = 0; i < m; ++i) {
      column[i] = A[i][s];
      most = larger(most, size_of(column[i]));
    }
    alone |= ~(size_of(column[s]) > SMALL_PIVOT<Real> * most);
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
