// Whether a certificate proves that a problem has no feasible point: proof.infeasible without free unknowns.
#pragma once

#include "arithmetic.h"

namespace jaxcontact {

// backward_error, telling, close, condition: BACKWARD_ERROR_BOUND eps, eps^DIGITS_KEPT, eps^DIGITS_OF_ABSENCE and
// CONDITION_BOUND / eps of bars.py.
struct JudgeRules {
  static constexpr int degeneracy = 64, pivot_floor = 16, certificate = 64;
  template <class Real>
  static constexpr Real backward_error = (sizeof(Real) == 8 ? 256 : 16) * eps<Real>;
  template <class Real>
  static constexpr Real telling = sizeof(Real) == 8 ? Real(0x1p-13) : Real(0x1.306fep-6);
  template <class Real>
  static constexpr Real close = sizeof(Real) == 8 ? Real(0x1p-26) : Real(0x1.6a09e6p-12);
  template <class Real>
  static constexpr Real condition = 1 / (64 * eps<Real>);
};

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

// Whether no z, w >= 0 satisfy P z - N w + q = 0, by y: proof.infeasible without free unknowns. N null: the identity.
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

}  // namespace jaxcontact
