// Exponents, powers of two and groups of lanes: what every kernel counts with.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

namespace jaxcontact {

template <class Real>
struct Format;

template <>
struct Format<double> {
  using Word = int64_t;
  typedef double Lanes __attribute__((vector_size(64)));
  typedef int64_t Masks __attribute__((vector_size(64)));
  static constexpr int fraction = 52, bias = 1023, width = 8;
};

template <>
struct Format<float> {
  using Word = int32_t;
  typedef float Lanes __attribute__((vector_size(64)));
  typedef int32_t Masks __attribute__((vector_size(64)));
  static constexpr int fraction = 23, bias = 127, width = 16;
};

template <class Real>
constexpr Real eps = std::numeric_limits<Real>::epsilon();

template <class Real>
constexpr Real infinity = std::numeric_limits<Real>::infinity();

template <class Real>
constexpr Real not_a_number = std::numeric_limits<Real>::quiet_NaN();

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

template <class Real>
using Lanes = typename Format<Real>::Lanes;
template <class Real>
using Masks = typename Format<Real>::Masks;

template <class Real>
inline Lanes<Real> all(Real x) {
  return x - Lanes<Real>{};
}

// The type of one number of N, a number or lanes.
template <class N>
struct NumberOf {
  using type = std::remove_reference_t<decltype(N{}[0])>;
};
template <>
struct NumberOf<double> {
  using type = double;
};
template <>
struct NumberOf<float> {
  using type = float;
};
template <class N>
using Number = typename NumberOf<N>::type;

template <class N>
inline N size_of(N x) {
  if constexpr (std::is_floating_point_v<N>) {
    return std::fabs(x);
  } else {
    using K = decltype(x < x);
    return (N)((K)x & std::numeric_limits<typename Format<Number<N>>::Word>::max());
  }
}

// Written out, since some compilers make two instructions of a comparison and a choice. With NaN it is b.
template <class N>
inline N larger(N a, N b) {
#if defined(__AVX512F__)
  if constexpr (std::is_same_v<N, Format<double>::Lanes>) return _mm512_max_pd(a, b);
  if constexpr (std::is_same_v<N, Format<float>::Lanes>) return _mm512_max_ps(a, b);
#endif
  return a > b ? a : b;
}

template <class N>
inline N smaller(N a, N b) {
#if defined(__AVX512F__)
  if constexpr (std::is_same_v<N, Format<double>::Lanes>) return _mm512_min_pd(a, b);
  if constexpr (std::is_same_v<N, Format<float>::Lanes>) return _mm512_min_ps(a, b);
#endif
  return a < b ? a : b;
}

template <class N>
inline N one_if_zero(N x) {
  return x == 0 ? N{} + 1 : x;
}

template <class Real>
inline Lanes<Real> lanes_at(const Real* x) {
  Lanes<Real> found;
  std::memcpy(&found, x, sizeof found);
  return found;
}

// n numbers, at most a group, with zeros behind.
template <class Real>
inline Lanes<Real> some_lanes_at(const Real* x, int n) {
  constexpr int W = Format<Real>::width;
  if (n >= W) return lanes_at(x);
#if defined(__AVX512F__)
  if constexpr (W == 8)
    return _mm512_maskz_loadu_pd((1u << n) - 1, x);
  else
    return _mm512_maskz_loadu_ps((1u << n) - 1, x);
#else
  Lanes<Real> found{};
  for (int lane = 0; lane < n; ++lane) found[lane] = x[lane];
  return found;
#endif
}

template <class Word>
inline auto masks_at(const Word* x) {
  typedef Word Found __attribute__((vector_size(64)));
  Found found;
  std::memcpy(&found, x, sizeof found);
  return found;
}

// 0, 1, 2, ...
template <class Real>
inline Masks<Real> lane_numbers() {
  if constexpr (Format<Real>::width == 8)
    return Masks<Real>{0, 1, 2, 3, 4, 5, 6, 7};
  else
    return Masks<Real>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
}

// Numbers of memory that stand `stride` apart.
template <class Real>
inline Lanes<Real> strided(const Real* x, int stride) {
  Lanes<Real> found;
  for (int lane = 0; lane < Format<Real>::width; ++lane) found[lane] = x[lane * stride];
  return found;
}

template <class Real>
inline void put(Lanes<Real> lanes, Real* x) {
  std::memcpy(x, &lanes, sizeof lanes);
}

// Lanes rotated by half, a quarter, ... of a group: what a sum or an extremum over its lanes takes.
template <class V>
inline V rotated(V x, int by) {
  if constexpr (sizeof(x) / sizeof(x[0]) == 8) {
    if (by == 4) return __builtin_shufflevector(x, x, 4, 5, 6, 7, 0, 1, 2, 3);
    if (by == 2) return __builtin_shufflevector(x, x, 2, 3, 4, 5, 6, 7, 0, 1);
    return __builtin_shufflevector(x, x, 1, 2, 3, 4, 5, 6, 7, 0);
  } else {
    if (by == 8) return __builtin_shufflevector(x, x, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7);
    if (by == 4) return __builtin_shufflevector(x, x, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3);
    if (by == 2) return __builtin_shufflevector(x, x, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1);
    return __builtin_shufflevector(x, x, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0);
  }
}

// Of two groups in a row: every other lane, and the reverse of that.
template <class V>
inline V evens(V a, V b) {
  if constexpr (sizeof(a) / sizeof(a[0]) == 8)
    return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14);
  else
    return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
}

template <class V>
inline V odds(V a, V b) {
  if constexpr (sizeof(a) / sizeof(a[0]) == 8)
    return __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15);
  else
    return __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
}

template <class V>
inline V lower_halves(V a, V b) {
  if constexpr (sizeof(a) / sizeof(a[0]) == 8)
    return __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
  else
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
}

template <class V>
inline V upper_halves(V a, V b) {
  if constexpr (sizeof(a) / sizeof(a[0]) == 8)
    return __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
  else
    return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
}

// n groups as they stand in memory, n numbers to a problem, to number j of all problems in x[j]; n a power of two.
template <int n, class V>
inline void by_number(V* x) {
  if constexpr (n > 1) {
    V even[n / 2], odd[n / 2];
    for (int k = 0; k < n / 2; ++k) even[k] = evens(x[2 * k], x[2 * k + 1]), odd[k] = odds(x[2 * k], x[2 * k + 1]);
    by_number<n / 2>(even), by_number<n / 2>(odd);
    for (int k = 0; k < n / 2; ++k) x[2 * k] = even[k], x[2 * k + 1] = odd[k];
  }
}

// The reverse.
template <int n, class V>
inline void by_problem(V* x) {
  if constexpr (n > 1) {
    V even[n / 2], odd[n / 2];
    for (int k = 0; k < n / 2; ++k) even[k] = x[2 * k], odd[k] = x[2 * k + 1];
    by_problem<n / 2>(even), by_problem<n / 2>(odd);
    for (int k = 0; k < n / 2; ++k)
      x[2 * k] = lower_halves(even[k], odd[k]), x[2 * k + 1] = upper_halves(even[k], odd[k]);
  }
}

template <class V, class Join>
inline auto over_lanes(V x, Join join) {
  for (int by = sizeof(x) / sizeof(x[0]) / 2; by; by /= 2) x = join(x, rotated(x, by));
  return x[0];
}

template <class V>
inline auto sum_of_lanes(V x) {
  return over_lanes(x, [](V a, V b) { return a + b; });
}

// In lane k the sum of the lanes of x[k], for a power of two of groups, repeated to fill the lanes; x is lost.
template <int n, class V>
inline V sums_of_lanes(V* x) {
  if constexpr (n == 1) {
    return x[0];
  } else {
    for (int k = 0; k < n / 2; ++k) x[k] = evens(x[2 * k], x[2 * k + 1]) + odds(x[2 * k], x[2 * k + 1]);
    return sums_of_lanes<n / 2>(x);
  }
}

template <class V>
inline auto largest_lane(V x) {
  return over_lanes(x, larger<V>);
}

template <class V>
inline auto smallest_lane(V x) {
  return over_lanes(x, smaller<V>);
}

// A bit for each lane that is true, which is -1.
template <class Real>
inline unsigned lane_bits(Masks<Real> mask) {
#if defined(__AVX512DQ__)
  if constexpr (sizeof(Real) == 8)
    return _mm512_movepi64_mask((__m512i)mask);
  else
    return _mm512_movepi32_mask((__m512i)mask);
#else
  unsigned bits = 0;
  for (int lane = 0; lane < Format<Real>::width; ++lane) bits |= (mask[lane] & 1) << lane;
  return bits;
#endif
}

template <class Real>
inline bool any_lane(Masks<Real> mask) {
#if defined(__AVX512DQ__)
  return lane_bits<Real>(mask) != 0;
#else
  return smallest_lane(mask) != 0;
#endif
}

// The first true lane of those that are; one is.
template <class Real>
inline int first_lane(Masks<Real> mask) {
  return __builtin_ctz(lane_bits<Real>(mask));
}

// max |x_j| over whole groups of lanes.
template <class Real>
inline Real largest_of(const Real* x, int n) {
  Lanes<Real> most{};
  for (int j = 0; j < n; j += Format<Real>::width) most = larger(most, size_of(lanes_at(x + j)));
  return largest_lane(most);
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

// 2^-e with 2^(e-1) <= x < 2^e, for x >= 0, a number or lanes; finite and not zero whatever x is.
template <class N>
inline N per_power_of_two(N x) {
  if constexpr (std::is_floating_point_v<N>) {
    return per_power_of_two(all(x))[0];
  } else {
    using F = Format<Number<N>>;
    using K = decltype(x < x);
    constexpr typename F::Word one = typename F::Word(1) << F::fraction;
    const K word = (2 * F::bias - 1) * one - ((K)x & (2 * F::bias + 1) * one);
    return (N)(word > one ? word : K{} + one);
  }
}

// Whole numbers, one to a lane.
template <class Real>
inline void write_integers(Masks<Real> from, int count, int* to) {
  typedef int Integers __attribute__((vector_size(sizeof(int) * Format<Real>::width)));
  const Integers found = __builtin_convertvector(from, Integers);
  std::memcpy(to, &found, count == Format<Real>::width ? sizeof found : sizeof(int) * count);
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
  return (((Masks<Real>)x >> F::fraction) & (2 * F::bias + 1)) - (F::bias - 1);
}

// 2^k for k inside the normal numbers.
template <class Real>
inline Lanes<Real> powers_of_two(Masks<Real> k) {
  return (Lanes<Real>)((k + Format<Real>::bias) << Format<Real>::fraction);
}

// The row length of a matrix in memory: whole groups of lanes, so that a row is a few instructions.
template <class Real>
constexpr int padded(int m) {
  return (m + Format<Real>::width - 1) / Format<Real>::width * Format<Real>::width;
}

}  // namespace jaxcontact
