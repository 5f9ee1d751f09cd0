// Exponents and powers of two, of numbers and of lanes.
#pragma once

#include "lanes.h"

namespace jaxcontact {

template <class Real>
inline typename Format<Real>::Word bits_of(Real x) {
  typename Format<Real>::Word word;
  std::memcpy(&word, &x, sizeof word);
  return word;
}

template <class Real>
inline bool is_finite(Real x) {
  return x - x == 0;
}

// e with 2^(e-1) <= |x| < 2^e; 0 at zero, at NaN and at infinity.
template <class Real>
inline int exponent(Real x) {
  using F = Format<Real>;
  if (x == 0 || !is_finite(x)) return 0;
  return int((bits_of(x) >> F::fraction) & (2 * F::bias + 1)) - F::bias + 1;
}

// 2^k exactly, k held two steps inside the normal numbers.
template <class Real>
inline Real power_of_two(int k) {
  using F = Format<Real>;
  const int low = 2 - F::bias, high = F::bias - 2;
  const typename F::Word word = typename F::Word((k < low ? low : k > high ? high : k) + F::bias) << F::fraction;
  Real x;
  std::memcpy(&x, &word, sizeof x);
  return x;
}

// 2^-e with 2^(e-1) <= x < 2^e, for lanes >= 0; finite and not zero whatever they are.
template <class V>
inline V per_power_of_two(V x) {
  using F = Format<Number<V>>;
  using K = decltype(x < x);
  constexpr typename F::Word one = typename F::Word(1) << F::fraction;
  const K word = (2 * F::bias - 1) * one - ((K)x & (2 * F::bias + 1) * one);
  return (V)(word > one ? word : K{} + one);
}

// x 2^k in two steps, so that only the product can overflow and not the factor.
template <class Real>
inline Real times_power_of_two(Real x, int k) {
  const int half = k >> 1;
  return x * power_of_two<Real>(half) * power_of_two<Real>(k - half);
}

// e with 2^(e-1) <= x < 2^e, for positive finite x.
template <class Real>
inline Masks<Real> exponents(Lanes<Real> x) {
  using F = Format<Real>;
  return (Masks<Real>)(((typename F::Bits)x >> F::fraction) & (2 * F::bias + 1)) - (F::bias - 1);
}

// k / 2 rounded down, for exponents k; few processors shift wide signed numbers.
template <class Real>
inline Masks<Real> halves(Masks<Real> k) {
  constexpr int above = 4 * Format<Real>::bias + 4;
  return (Masks<Real>)((typename Format<Real>::Bits)(k + above) >> 1) - above / 2;
}

// 2^k for k inside the normal numbers.
template <class Real>
inline Lanes<Real> powers_of_two(Masks<Real> k) {
  return (Lanes<Real>)((k + Format<Real>::bias) << Format<Real>::fraction);
}

}  // namespace jaxcontact
