// One to four contacts, every mode tried: complementarity/direct.py and minors.py, several problems to an instruction.
#pragma once

#include "group_findings.h"

namespace jaxcontact {

// More contacts have more modes than straight code should list.
constexpr int DIRECT_LIMIT = 4;

struct DirectRules {
  static constexpr int regular = 64, clear = 1024, corrections = 3, corrections_of_two = 2;
};

// What candidates are compared by: eta of z up to a factor of two, since powers of two stand for the largest z and w.
template <int m, class V>
inline V rough_error(const V (&M)[m][m], const V (&q)[m], const V (&z)[m]) {
  V w[m], size_z{}, size_w{};
  for (int i = 0; i < m; ++i) {
    V sum = q[i], terms = size_of(q[i]);
    for (int j = 0; j < m; ++j) {
      sum += M[i][j] * z[j];
      terms += size_of(M[i][j]) * z[j];
    }
    w[i] = sum;
    size_z = larger(size_z, z[i]);
    size_w = larger(size_w, terms);
  }
  const V per_z = per_power_of_two(size_z), per_w = per_power_of_two(size_w);
  V eta{};
  for (int i = 0; i < m; ++i) {
    const V part = size_of(smaller(z[i] * per_z, w[i] * per_w));
    eta = part <= eta ? eta : part;
  }
  return eta;
}

template <class V>
inline V quotient(V a, V b) {
  return b == 0 ? V{} : a / (b == 0 ? b + 1 : b);
}

// One or two contacts: every vertex of every mode, so that dependent equations hide nothing.
template <class Real>
struct Vertices {
  template <int m>
  static void best(const Group<m, Real>& group, Lanes<Real> (&z)[m]) {
    using V = Lanes<Real>;
    const auto& M = group.M;
    const auto& q = group.q;
    for (V& x : z) x = V{};
    V least = rough_error<m>(M, q, z);
    const auto offer = [&](const V(&candidate)[m]) {
      const V eta = rough_error<m>(M, q, candidate);
      const auto better = eta < least;
      for (int i = 0; i < m; ++i) z[i] = better ? candidate[i] : z[i];
      least = better ? eta : least;
    };
    for (int j = 0; j < m; ++j)
      for (int i = 0; i < m; ++i) {
        V candidate[m] = {};
        candidate[j] = cut(quotient(-q[i], M[i][j]));
        offer(candidate);
      }
    if constexpr (m == 2) {
      const V volume = M[0][0] * M[1][1] - M[0][1] * M[1][0], inverse = quotient(V{} + 1, volume);
      V x[2] = {(M[0][1] * q[1] - M[1][1] * q[0]) * inverse, (M[1][0] * q[0] - M[0][0] * q[1]) * inverse};
      for (int k = 0; k < DirectRules::corrections_of_two; ++k) {
        const V a = M[0][0] * x[0] + M[0][1] * x[1] + q[0], b = M[1][0] * x[0] + M[1][1] * x[1] + q[1];
        x[0] += (M[0][1] * b - M[1][1] * a) * inverse;
        x[1] += (M[1][0] * a - M[0][0] * b) * inverse;
      }
      const V candidate[2] = {cut(x[0]), cut(x[1])};
      offer(candidate);
    }
  }
};

// Three or four contacts: the minors that the modes share (see minors.py).
template <int m, class Real>
struct Minors {
  using V = Lanes<Real>;
  // of[R][C]: rows R against as many columns C, bit m of C being the load
  V of[1 << m][2 << m];

  explicit Minors(const Group<m, Real>& group) {
    of[0][0] = all(Real(1));
    for (int R = 1; R < 1 << m; ++R) {
      const int first = __builtin_ctz(R), rest = R & (R - 1);
      for (int C = 1; C < 2 << m; ++C) {
        if (__builtin_popcount(C) != __builtin_popcount(R)) continue;
        V sum{};
        bool minus = false;
        for (int c = 0; c <= m; ++c) {
          if (!(C >> c & 1)) continue;
          const V term = (c < m ? group.M[first][c < m ? c : 0] : group.q[first]) * of[rest][C & ~(1 << c)];
          sum = minus ? sum - term : sum + term;
          minus = !minus;
        }
        of[R][C] = sum;
      }
    }
  }

  // The principal minor of S with column k replaced by the load.
  V replaced(int S, int k) const {
    const V minor = of[S][(S & ~(1 << k)) | 1 << m];
    return __builtin_popcount(S >> (k + 1)) & 1 ? -minor : minor;
  }

  // z of the mode whose smallest unknown is largest; none: no mode has a solution, beyond the doubt of rounding.
  Masks<Real> best(V (&z)[m]) const {
    V margin_of_best = all(-infinity<Real>), smallest = all(Real(1));
    for (V& x : z) x = V{};
    for (int S = 0; S < 1 << m; ++S) {
      const V volume = of[S][S], size = size_of(volume), sign = volume < 0 ? V{} - 1 : V{} + 1;
      V unit = size, least = all(infinity<Real>), values[m];
      for (int k = 0; k < m; ++k) {
        const bool pressing = S >> k & 1;
        const V x = sign * (pressing ? -replaced(S, k) : replaced(S | 1 << k, k));
        values[k] = pressing ? x : V{};
        if (pressing) unit = larger(unit, size_of(x));
        least = smaller(least, x);
      }
      const auto regular = size > DirectRules::regular * eps<Real>;
      const V margin = regular ? least / one_if_zero(unit) : all(-infinity<Real>);
      const auto better = margin > margin_of_best;
      const V inverse = 1 / one_if_zero(size);
      for (int k = 0; k < m; ++k) z[k] = better ? values[k] * inverse : z[k];
      margin_of_best = better ? margin : margin_of_best;
      smallest = smaller(smallest, size);
    }
    return margin_of_best < -DirectRules::clear * eps<Real> / larger(smallest, all(eps<Real>));
  }
};

// What the system of the mode of z says of a miss: K d = miss on the pressing rows, d = 0 on the others.
template <int m, class Real>
inline void correct_in_mode(const Group<m, Real>& group, const Lanes<Real> (&miss)[m], Lanes<Real> (&z)[m]) {
  using V = Lanes<Real>;
  Group<m, Real> mode;
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) mode.M[i][j] = (z[i] != 0) & (z[j] != 0) ? group.M[i][j] : i == j ? V{} + 1 : V{};
    mode.q[i] = z[i] != 0 ? miss[i] : V{};
  }
  const Minors<m, Real> minors(mode);
  const int whole = (1 << m) - 1;
  const V inverse = quotient(V{} + 1, minors.of[whole][whole]);
  for (int i = 0; i < m; ++i) z[i] -= z[i] != 0 ? minors.replaced(whole, i) * inverse : V{};
}

// A group of problems.
template <int m, class Real>
Ended<Real> direct(GroupJudge<m, Real>& judge, Real* z, Real* certificate) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const Given<m, Real>& given = judge.given;
  Group<m, Real> group;
  load(given, group);
  V found[m];
  K none = ~K{};
  if constexpr (m <= 2) {
    Vertices<Real>::template best<m>(group, found);
    conclude(group, judge, found, [](K open) { return open; }, z);
  } else {
    none = Minors<m, Real>(group).best(found);
    const auto correct = [&group](const V(&miss)[m], V(&x)[m]) { correct_in_mode<m, Real>(group, miss, x); };
    conclude(
        group, judge, found,
        [&](K open) { return refine_lanes(group, open, found, DirectRules::corrections, correct); }, z);
  }
  return {none ? K{} + int(NO_SOLUTION) : K{} + int(INACCURATE),
          hopeless_rows(given, certificate) ? certificate : nullptr};
}

}  // namespace jaxcontact
