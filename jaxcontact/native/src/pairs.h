// One or two complementary pairs in horizontal form, P z - N w + q = 0, as in complementarity/pairs.py, with all that
// the judge asks of them.
#pragma once

#include "findings.h"

namespace jaxcontact {

constexpr int PAIRS_LIMIT = 2;

// Where a group's results go; no certificate: whether it proves something is in the status.
template <class Real>
struct PairsFound {
  Real *z, *w, *condition;
  bool *active, *degenerate;
  Found<Real> found;
};

// 2^exponent, and 1 where `exponent` is zero: at zero, at infinity, at NaN.
template <class Real>
inline Lanes<Real> size_in_powers_of_two(Lanes<Real> x) {
  constexpr int low = 2 - Format<Real>::bias, high = Format<Real>::bias - 2;
  Masks<Real> k = (x > 0) & (x < infinity<Real>) ? exponents<Real>(x) : Masks<Real>{};
  k = k < low ? Masks<Real>{} + low : k > high ? Masks<Real>{} + high : k;
  return powers_of_two<Real>(k);
}

// a d - b c to the last digits, whatever cancels (Kahan).
template <class Real>
inline Lanes<Real> det2(Lanes<Real> a, Lanes<Real> b, Lanes<Real> c, Lanes<Real> d) {
  Lanes<Real> found;
  for (int lane = 0; lane < Format<Real>::width; ++lane) {
    const Real product = b[lane] * c[lane], lost = std::fma(-b[lane], c[lane], product);
    found[lane] = std::fma(a[lane], d[lane], -product) + lost;
  }
  return found;
}

// `count` problems, up to one group.
template <int m, class Real>
struct Pairs {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  // columns of P and -N, balanced: row_i (P_ij or -N_ij) column_j
  V P[m][m], N[m][m], q[m], A[m][2 * m], load[m], row[m], column[2 * m];
  V z[m], w[m], certificate[m];
  K dependent;

  static V over(V a, V b) { return a / (b == 0 ? V{} + 1 : b); }
  static V per(V x) { return 1 / one_if_zero(x); }

  Pairs(const Real* P_, const Real* N_, const Real* q_, int count) {
    read_lanes<m * m>(P_, count, &P[0][0]);
    read_lanes<m * m>(N_, count, &N[0][0]);
    read_lanes<m>(q_, count, q);
    for (int i = 0; i < m; ++i) {
      V most{};
      for (int j = 0; j < m; ++j) {
        A[i][j] = P[i][j], A[i][m + j] = -N[i][j];
        most = larger(most, larger(size_of(P[i][j]), size_of(N[i][j])));
      }
      row[i] = 1 / size_in_powers_of_two<Real>(most);
      load[i] = -q[i] * row[i];
    }
    for (int j = 0; j < 2 * m; ++j) {
      V most{};
      for (int i = 0; i < m; ++i) most = larger(most, size_of(A[i][j] *= row[i]));
      column[j] = 1 / size_in_powers_of_two<Real>(most);
      for (int i = 0; i < m; ++i) A[i][j] *= column[j];
    }
    choose();
    separate();
  }

  // The candidate of least violation among all vertices of all modes.
  void choose() {
    V best[2 * m] = {}, least = violation(best);
    const auto offer = [&](const V(&candidate)[2 * m], K sound) {
      const V found = violation(candidate);
      const K better = sound & (found < least);
      for (int j = 0; j < 2 * m; ++j) best[j] = better ? candidate[j] : best[j];
      least = better ? found : least;
    };
    K regular{};
    for (int j = 0; j < 2 * m; ++j)
      for (int i = 0; i < m; ++i) {
        V candidate[2 * m] = {};
        candidate[j] = cut(over(load[i], A[i][j]));
        const K sound = A[i][j] != 0;
        if (m == 1) regular |= sound;
        offer(candidate, sound);
      }
    if constexpr (m == 2) {
      for (int j = 0; j < 2 * m; j += m)
        for (int k = 1; k < 2 * m; k += m) {
          const V a = A[0][j], c = A[1][j], b = A[0][k], d = A[1][k], volume = det2<Real>(a, b, c, d);
          const V size = larger(larger(size_of(a), size_of(b)), larger(size_of(c), size_of(d)));
          const K sound = size_of(volume) > JudgeRules::pivot_floor * m * eps<Real> * size * size;
          V candidate[2 * m] = {};
          candidate[j] = cut(over(det2<Real>(load[0], b, load[1], d), volume));
          candidate[k] = cut(over(det2<Real>(a, load[0], c, load[1]), volume));
          regular |= sound;
          offer(candidate, sound);
        }
    }
    dependent = ~regular;
    for (int j = 0; j < m; ++j) {
      const V x = best[j] * column[j] - best[m + j] * column[m + j];
      z[j] = cut(x), w[j] = cut(-x);
    }
  }

  // The largest |sum_j y_j A_j - load|, relative to the largest sum of terms.
  V violation(const V (&y)[2 * m]) const {
    V most{}, size{};
    for (int i = 0; i < m; ++i) {
      V miss = -load[i], terms = size_of(load[i]);
      for (int j = 0; j < 2 * m; ++j) {
        miss += y[j] * A[i][j];
        terms += y[j] * size_of(A[i][j]);
      }
      miss = size_of(miss);
      most = miss <= most ? most : miss;
      size = larger(size, terms);
    }
    return most * per(size);
  }

  // y >= 0 on all columns with the lowest y'load, among the inner normals of the faces of their cone, the columns
  // themselves and the load reversed; or zero.
  void separate() {
    V lowest{};
    for (V& part : certificate) part = V{};
    const auto offer = [&](const V(&normal)[m]) {
      V length{}, y[m], fall{};
      for (const V& part : normal) length = larger(length, size_of(part));
      const V unit = 1 / size_in_powers_of_two<Real>(length);  // no rounding
      for (int i = 0; i < m; ++i) {
        y[i] = normal[i] * unit;
        fall += y[i] * load[i];
      }
      K better = fall < lowest;
      for (int j = 0; j < 2 * m; ++j) {
        V along{}, size{};
        for (int i = 0; i < m; ++i) {
          along += y[i] * A[i][j];
          size += size_of(A[i][j]);
        }
        better &= along >= -JudgeRules::pivot_floor * eps<Real> * size;
      }
      for (int i = 0; i < m; ++i) certificate[i] = better ? y[i] : certificate[i];
      lowest = better ? fall : lowest;
    };
    V reversed[m];
    for (int i = 0; i < m; ++i) reversed[i] = -load[i];
    offer(reversed);
    for (int j = 0; j < 2 * m; ++j) {
      V own[m];
      for (int i = 0; i < m; ++i) own[i] = A[i][j];
      offer(own);
      if constexpr (m == 2) {
        const V left[m] = {-own[1], own[0]}, right[m] = {own[1], -own[0]};
        offer(left);
        offer(right);
      }
    }
    for (int i = 0; i < m; ++i) certificate[i] *= row[i];
  }

  // What the judge measures, and where it goes.
  void judge(const Real* P_, const Real* N_, const Real* q_, int count, const PairsFound<Real>& to) const {
    V unit_z[m], unit_w[m], size{}, both{}, miss{}, terms{}, heaviest{}, point{}, data{};
    for (int i = 0; i < m; ++i) {
      V most_P{}, most_N{}, sum = q[i], part = size_of(q[i]);
      for (int j = 0; j < m; ++j) {
        most_P = larger(most_P, size_of(P[j][i]));
        most_N = larger(most_N, size_of(N[j][i]));
        sum += P[i][j] * z[j] - N[i][j] * w[j];
        part += size_of(P[i][j]) * z[j] + size_of(N[i][j]) * w[j];
        data += (P[i][j] - P[i][j]) + (N[i][j] - N[i][j]);
      }
      data += q[i] - q[i];
      point += (z[i] - z[i]) + (w[i] - w[i]) + (sum - sum);
      unit_z[i] = size_in_powers_of_two<Real>(most_P), unit_w[i] = size_in_powers_of_two<Real>(most_N);
      const V a = z[i] * unit_z[i], b = w[i] * unit_w[i];
      size = larger(size, larger(a, b));
      both = larger(both, smaller(a, b));
      miss = larger(miss, size_of(sum));
      terms = larger(terms, part);
      heaviest = larger(heaviest, size_of(q[i]));
    }
    const K whole = point == 0;
    const V share = per(size), lost = all(not_a_number<Real>);
    const V eta = whole ? larger(miss * per(terms), both * share) : lost, rho = whole ? miss * per(heaviest) : lost;
    K active[m], degenerate[m];
    V mode[m][m];
    for (int i = 0; i < m; ++i) {
      const V zero = all(JudgeRules::degeneracy * eps<Real>);
      const V a = z[i] * unit_z[i] * share, b = w[i] * unit_w[i] * share;
      active[i] = (a > zero) & ((b <= zero) | (a > b));
      degenerate[i] = (a <= zero) & (b <= zero);
      for (int j = 0; j < m; ++j) mode[j][i] = active[i] | degenerate[i] ? P[j][i] : N[j][i];
    }
    const V condition = condition_of(mode);
    write_lanes<m>(z, count, to.z);
    write_lanes<m>(w, count, to.w);
    write_lanes<1>(&condition, count, to.condition);
    write_lanes<1>(&eta, count, to.found.eta);
    write_lanes<1>(&rho, count, to.found.rho);
    write_masks<m, Real>(active, count, to.active);
    write_masks<m, Real>(degenerate, count, to.degenerate);
    const K flags = ((data == 0) & int(DATA_FINITE)) | (whole & int(POINT_FINITE)) | (dependent & int(DEPENDENT)) |
                    bounds_held<Real>(eta, rho) | ((condition <= JudgeRules::condition<Real>)&int(MODERATE));
    K status = K{} + int(SOLVED);
    const K open = ~(clear<Real>(eta, rho) & (data == 0) & whole & ~dependent);
    for (int lane = 0; lane < count && any_lane<Real>(open); ++lane) {
      if (!open[lane]) continue;
      Real y[m], own_z[m], own_w[m];
      for (int i = 0; i < m; ++i) y[i] = certificate[i][lane], own_z[i] = unit_z[i][lane], own_w[i] = unit_w[i][lane];
      const bool proved = !clear<Real>(eta[lane], rho[lane]) &&
                          proves<Real>(P_ + lane * m * m, N_ + lane * m * m, q_ + lane * m, y, m, own_z, own_w);
      status[lane] = status_of(int(flags[lane]) | (proved ? PROVED : 0), NO_SOLUTION);
    }
    write_integers<Real>(status, count, to.found.told);
  }

  // |K| |K^-1| of the balanced K, as in complementarity/inverse.py; infinite where K is singular up to rounding.
  static V condition_of(V (&B)[m][m]) {
    const auto norm = [&B] {
      V largest{};
      for (int i = 0; i < m; ++i) {
        V sum{};
        for (int j = 0; j < m; ++j) sum += size_of(B[i][j]);
        largest = sum <= largest ? largest : sum;
      }
      return largest;
    };
    V largest{};
    for (int i = 0; i < m; ++i) {
      V most{};
      for (int j = 0; j < m; ++j) most = larger(most, size_of(B[i][j]));
      for (int j = 0; j < m; ++j) B[i][j] /= size_in_powers_of_two<Real>(most);
    }
    for (int j = 0; j < m; ++j) {
      V most{};
      for (int i = 0; i < m; ++i) most = larger(most, size_of(B[i][j]));
      for (int i = 0; i < m; ++i) largest = larger(largest, size_of(B[i][j] /= size_in_powers_of_two<Real>(most)));
    }
    const V before = norm();
    K regular;
    if constexpr (m == 1) {
      regular = largest > 0;
      B[0][0] = 1 / (regular ? B[0][0] : V{} + 1);
    } else {
      const V volume = det2<Real>(B[0][0], B[0][1], B[1][0], B[1][1]);
      regular = size_of(volume) > JudgeRules::pivot_floor * m * eps<Real> * largest * largest;
      const V scale = 1 / (regular ? volume : V{} + 1), first = B[0][0];
      B[0][0] = B[1][1] * scale, B[1][1] = first * scale;
      B[0][1] *= -scale, B[1][0] *= -scale;
    }
    const V found = before * norm();
    return regular ? found : all(infinity<Real>);
  }
};

}  // namespace jaxcontact
