// Groups of numbers that one instruction works on, as wide as the processor has them.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace jaxcontact {

#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define JAXCONTACT_BYTES 64
#elif defined(__AVX2__)
#define JAXCONTACT_BYTES 32
#else
#define JAXCONTACT_BYTES 16
#endif

template <class Real>
struct Format;

template <>
struct Format<double> {
  using Word = int64_t;
  typedef double Lanes __attribute__((vector_size(JAXCONTACT_BYTES)));
  typedef int64_t Masks __attribute__((vector_size(JAXCONTACT_BYTES)));
  typedef uint64_t Bits __attribute__((vector_size(JAXCONTACT_BYTES)));
  static constexpr int fraction = 52, bias = 1023, width = JAXCONTACT_BYTES / sizeof(double);
};

template <>
struct Format<float> {
  using Word = int32_t;
  typedef float Lanes __attribute__((vector_size(JAXCONTACT_BYTES)));
  typedef int32_t Masks __attribute__((vector_size(JAXCONTACT_BYTES)));
  typedef uint32_t Bits __attribute__((vector_size(JAXCONTACT_BYTES)));
  static constexpr int fraction = 23, bias = 127, width = JAXCONTACT_BYTES / sizeof(float);
};

template <class Real>
using Lanes = typename Format<Real>::Lanes;
template <class Real>
using Masks = typename Format<Real>::Masks;  // -1 where true

template <class Real>
constexpr Real eps = std::numeric_limits<Real>::epsilon();

template <class Real>
constexpr Real infinity = std::numeric_limits<Real>::infinity();

template <class Real>
constexpr Real not_a_number = std::numeric_limits<Real>::quiet_NaN();

// The type of one lane.
template <class V>
using Number = std::remove_reference_t<decltype(V{}[0])>;

#define JAXCONTACT_INLINE inline __attribute__((always_inline))

// body(i) for i = 0 ... n - 1, each a constant, so that small arrays which it indexes can live in registers.
template <class Body, int... i>
JAXCONTACT_INLINE void each(Body body, std::integer_sequence<int, i...>) {
  (body(std::integral_constant<int, i>{}), ...);
}

template <int n, class Body>
JAXCONTACT_INLINE void each(Body body) {
  each(body, std::make_integer_sequence<int, n>{});
}

template <class Real>
inline Lanes<Real> all(Real x) {
  return x - Lanes<Real>{};
}

template <class N>
inline N size_of(N x) {
  if constexpr (std::is_floating_point_v<N>) {
    return std::fabs(x);
  } else {
    using K = decltype(x < x);
    return (N)((K)x & std::numeric_limits<typename Format<Number<N>>::Word>::max());
  }
}

// Written out for lanes, since some compilers make two instructions of a comparison and a choice. With NaN it is b.
template <class N>
inline N larger(N a, N b) {
#if JAXCONTACT_BYTES == 64
  if constexpr (std::is_same_v<N, Lanes<double>>) return _mm512_max_pd(a, b);
  if constexpr (std::is_same_v<N, Lanes<float>>) return _mm512_max_ps(a, b);
#elif JAXCONTACT_BYTES == 32
  if constexpr (std::is_same_v<N, Lanes<double>>) return _mm256_max_pd(a, b);
  if constexpr (std::is_same_v<N, Lanes<float>>) return _mm256_max_ps(a, b);
#endif
  return a > b ? a : b;
}

template <class N>
inline N smaller(N a, N b) {
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

template <class Word>
inline auto masks_at(const Word* x) {
  typedef Word Found __attribute__((vector_size(JAXCONTACT_BYTES)));
  Found found;
  std::memcpy(&found, x, sizeof found);
  return found;
}

template <class Real>
inline void put(Lanes<Real> lanes, Real* x) {
  std::memcpy(x, &lanes, sizeof lanes);
}

template <class Real, int... i>
inline Masks<Real> lane_numbers(std::integer_sequence<int, i...>) {
  return Masks<Real>{i...};
}

// 0, 1, 2, ...
template <class Real>
inline Masks<Real> lane_numbers() {
  return lane_numbers<Real>(std::make_integer_sequence<int, Format<Real>::width>{});
}

// n numbers, at most a group, with zeros behind.
template <class Real>
inline Lanes<Real> some_lanes_at(const Real* x, int n) {
  constexpr int W = Format<Real>::width;
  if (n >= W) return lanes_at(x);
#if JAXCONTACT_BYTES == 64
  if constexpr (sizeof(Real) == 8)
    return _mm512_maskz_loadu_pd((1u << n) - 1, x);
  else
    return _mm512_maskz_loadu_ps((1u << n) - 1, x);
#elif JAXCONTACT_BYTES == 32
  const Masks<Real> here = lane_numbers<Real>() < n;
  if constexpr (sizeof(Real) == 8)
    return _mm256_maskload_pd(x, (__m256i)here);
  else
    return _mm256_maskload_ps(x, (__m256i)here);
#else
  Lanes<Real> found{};
  for (int lane = 0; lane < n; ++lane) found[lane] = x[lane];
  return found;
#endif
}

// Numbers of memory that stand `stride` apart.
template <class Real>
inline Lanes<Real> strided(const Real* x, int stride) {
  Lanes<Real> found;
  for (int lane = 0; lane < Format<Real>::width; ++lane) found[lane] = x[lane * stride];
  return found;
}

// In lane i number at(i, width) of two groups in a row.
template <class V, class At, int... i>
inline V shuffled(V a, V b, At at, std::integer_sequence<int, i...>) {
#if defined(__clang__) || __GNUC__ >= 12
  return __builtin_shufflevector(a, b, at(i, int(sizeof...(i)))...);
#else
  return __builtin_shuffle(a, b, decltype(a < b){at(i, int(sizeof...(i)))...});
#endif
}

template <class V, class At>
inline V shuffled(V a, V b, At at) {
  return shuffled(a, b, at, std::make_integer_sequence<int, sizeof(V) / sizeof(Number<V>)>{});
}

// Of two groups in a row: every other lane, and the reverse of that.
template <class V>
inline V evens(V a, V b) {
  return shuffled(a, b, [](int i, int) { return 2 * i; });
}

template <class V>
inline V odds(V a, V b) {
  return shuffled(a, b, [](int i, int) { return 2 * i + 1; });
}

template <class V>
inline V lower_halves(V a, V b) {
  return shuffled(a, b, [](int i, int width) { return i / 2 + i % 2 * width; });
}

template <class V>
inline V upper_halves(V a, V b) {
  return shuffled(a, b, [](int i, int width) { return width / 2 + i / 2 + i % 2 * width; });
}

// n groups as they stand in memory, n numbers to a problem, to number j of all problems in x[j]; n a power of two.
template <int n, class V>
JAXCONTACT_INLINE void by_number(V* x) {
  if constexpr (n > 1) {
    V even[n / 2], odd[n / 2];
    for (int k = 0; k < n / 2; ++k) even[k] = evens(x[2 * k], x[2 * k + 1]), odd[k] = odds(x[2 * k], x[2 * k + 1]);
    by_number<n / 2>(even), by_number<n / 2>(odd);
    for (int k = 0; k < n / 2; ++k) x[2 * k] = even[k], x[2 * k + 1] = odd[k];
  }
}

// The reverse.
template <int n, class V>
JAXCONTACT_INLINE void by_problem(V* x) {
  if constexpr (n > 1) {
    V even[n / 2], odd[n / 2];
    for (int k = 0; k < n / 2; ++k) even[k] = x[2 * k], odd[k] = x[2 * k + 1];
    by_problem<n / 2>(even), by_problem<n / 2>(odd);
    for (int k = 0; k < n / 2; ++k)
      x[2 * k] = lower_halves(even[k], odd[k]), x[2 * k + 1] = upper_halves(even[k], odd[k]);
  }
}

// In lane k the sum of the lanes of x[k], for as many groups as a group has lanes; x is lost.
template <int n, class V>
inline V sums_of_lanes(V* x) {
  if constexpr (n == 1) {
    return x[0];
  } else {
    for (int k = 0; k < n / 2; ++k) x[k] = evens(x[2 * k], x[2 * k + 1]) + odds(x[2 * k], x[2 * k + 1]);
    return sums_of_lanes<n / 2>(x);
  }
}

// What `join` makes of all lanes, whatever their order.
template <class V, class Join, int by = sizeof(V) / sizeof(Number<V>) / 2>
inline auto over_lanes(V x, Join join, std::integral_constant<int, by> = {}) {
  if constexpr (by == 0) {
    return x[0];
  } else {
    const V other = shuffled(x, x, [](int i, int width) { return (i + by) % width; });
    return over_lanes(join(x, other), join, std::integral_constant<int, by / 2>{});
  }
}

template <class V>
inline auto sum_of_lanes(V x) {
  return over_lanes(x, [](V a, V b) { return a + b; });
}

template <class V>
inline auto largest_lane(V x) {
  return over_lanes(x, larger<V>);
}

template <class V>
inline auto smallest_lane(V x) {
  return over_lanes(x, smaller<V>);
}

// max |x_j| over whole groups of lanes.
template <class Real>
inline Real largest_of(const Real* x, int n) {
  Lanes<Real> most{};
  for (int j = 0; j < n; j += Format<Real>::width) most = larger(most, size_of(lanes_at(x + j)));
  return largest_lane(most);
}

// A bit for each lane that is true.
template <class Real>
inline unsigned lane_bits(Masks<Real> mask) {
#if JAXCONTACT_BYTES == 64
  if constexpr (sizeof(Real) == 8)
    return _mm512_movepi64_mask((__m512i)mask);
  else
    return _mm512_movepi32_mask((__m512i)mask);
#elif JAXCONTACT_BYTES == 32
  if constexpr (sizeof(Real) == 8)
    return _mm256_movemask_pd((__m256d)mask);
  else
    return _mm256_movemask_ps((__m256)mask);
#elif defined(__SSE2__)
  if constexpr (sizeof(Real) == 8)
    return _mm_movemask_pd((__m128d)mask);
  else
    return _mm_movemask_ps((__m128)mask);
#else
  unsigned bits = 0;
  for (int lane = 0; lane < Format<Real>::width; ++lane) bits |= (mask[lane] & 1u) << lane;
  return bits;
#endif
}

template <class Real>
inline bool any_lane(Masks<Real> mask) {
  return lane_bits<Real>(mask) != 0;
}

// The first true lane of those that are; one is.
template <class Real>
inline int first_lane(Masks<Real> mask) {
  return __builtin_ctz(lane_bits<Real>(mask));
}

// Whole numbers, one to a lane.
template <class Real>
inline void write_integers(Masks<Real> from, int count, int* to) {
  typedef int Integers __attribute__((vector_size(sizeof(int) * Format<Real>::width)));
  const Integers found = __builtin_convertvector(from, Integers);
  std::memcpy(to, &found, count == Format<Real>::width ? sizeof found : sizeof(int) * count);
}

// The row length of a matrix in memory: whole groups of lanes, so that a row is a few instructions.
template <class Real>
constexpr int padded(int m) {
  return (m + Format<Real>::width - 1) / Format<Real>::width * Format<Real>::width;
}

}  // namespace jaxcontact
