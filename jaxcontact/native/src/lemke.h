// Lemke's method with lexicographic ties, step for step as in complementarity/lemke.py.
#pragma once

#include "group_findings.h"

namespace jaxcontact {

struct LemkeRules {
  template <class Real>
  static constexpr Real tie = (sizeof(Real) == 8 ? Real(1e4) : Real(8)) * eps<Real>;
  template <class Real>
  static constexpr Real pivot = (sizeof(Real) == 8 ? Real(1e5) : Real(8)) * eps<Real>;
};

// Leave only those tied rows whose ratio equals the smallest one up to the tolerance; how many are left.
template <class Real>
inline int narrow(const Real* ratio, char* tied, int m) {
  Real least = infinity<Real>;
  for (int i = 0; i < m; ++i) least = tied[i] && ratio[i] < least ? ratio[i] : least;
  const Real limit = least + LemkeRules::tie<Real> * (1 + size_of(least));
  int count = 0;
  for (int i = 0; i < m; ++i) count += tied[i] = tied[i] && ratio[i] <= limit;
  return count;
}

// The row that leaves as `column` (in whole groups) enters by its fall, -1 where nothing blocks: it falls by more
// than `floor` in the rows that take part.
template <class Real>
inline int leaving_row(Workspace<Real>& work, const Real* column, Real floor, const Real* T, int stride) {
  using V = Lanes<Real>;
  constexpr int W = Format<Real>::width;
  const int m = work.m;
  char* tied = work.tied.data();
  Real* ratio = work.ratio.data();
  V low = all(infinity<Real>);
  for (int i = 0; i < m; i += W) {
    const V fall = lanes_at(column + i);
    const auto candidate = fall > floor;
    const V own = candidate ? lanes_at(&work.values[i]) / (candidate ? fall : V{} + 1) : all(infinity<Real>);
    put(own, ratio + i);
    low = smaller(own, low);
  }
  const Real least = smallest_lane(low), limit = least + LemkeRules::tie<Real> * (1 + size_of(least));
  int count = 0, first = 0;
  for (int i = 0; i < m; i += W) {
    const unsigned here = lane_bits<Real>(lanes_at(ratio + i) <= limit);
    if (here && !count) first = i + __builtin_ctz(here);
    count += __builtin_popcount(here);
  }
  if (count == 1 && least < infinity<Real>) return first;
  for (int i = 0; i < m; ++i) tied[i] = column[i] > floor;
  count = narrow(ratio, tied, m);
  for (int i = 0; i < m; ++i)
    if (tied[i] && work.basic[i] == 2 * m) return i;  // the artificial variable wins any tie
  for (int j = 0; j < m && count > 1; ++j) {
    // column j of the inverse: the fall of the basis as w_j rises, or a unit vector where w_j is basic
    int place = -1;
    for (int k = 0; k <= m; ++k)
      if (work.nonbasic[k] == j) place = k;
    for (int i = 0; i < m; ++i) {
      if (!tied[i]) continue;
      const Real entry = place >= 0 ? -T[i * stride + place] : Real(work.basic[i] == j);
      ratio[i] = entry / column[i];
    }
    count = narrow(ratio, tied, m);
  }
  for (int i = 0; i < m; ++i)
    if (tied[i]) return i;
  return -1;
}

// One problem. covering: (m) or null for ones; certificate (m): the direction of a ray, zeros otherwise.
template <int S, class Real>
void lemke(const Real* M, const Real* q, const Real* covering, int budget, Workspace<Real>& work, Real* z,
           Real* certificate, int* outcome, int* steps) {
  using V = Lanes<Real>;
  const int m = work.m, stride = S ? S : work.stride;
  Real *T = work.T.data(), *values = work.values.data(), *column = work.miss.data();
  const Units units = scaled<S>(M, q, m, stride, work.rows.data(), work.unit.data(), work.M.data(), work.q.data());
  std::memcpy(T, work.M.data(), sizeof(Real) * m * stride);
  std::memcpy(values, work.q.data(), sizeof(Real) * stride);
  bool trivial = true;
  for (int i = 0; i < m; ++i) {
    T[i * stride + m] = covering ? covering[i] : 1;
    work.basic[i] = i;
    work.nonbasic[i] = m + i;
    trivial &= values[i] >= 0;
  }
  work.nonbasic[m] = 2 * m;
  int entering = m, count = 0;
  *outcome = trivial ? SOLVED : MAX_STEPS;

  const auto take = [&](int leaving) {
    exchange<S>(T, values, work.right.data(), m, stride, leaving, entering);
    const int left = work.basic[leaving];
    work.basic[leaving] = work.nonbasic[entering];
    work.nonbasic[entering] = left;
    if (left == 2 * m) *outcome = SOLVED;
    const int complement = left < m ? left + m : left - m;
    int next = 0;
    for (int k = m; k >= 0; --k) next = work.nonbasic[k] == complement ? k : next;
    entering = next;
  };

  if (!trivial) {  // the artificial variable enters for the most violated row
    for (int i = 0; i < m; ++i) column[i] = T[i * stride + m];
    const int leaving = leaving_row(work, column, Real(0), T, stride);
    if (leaving >= 0)
      take(leaving);  // else q is not a number
    else
      *outcome = INACCURATE;
  }
  while (*outcome == MAX_STEPS && count < budget) {
    ++count;
    V most{};
    for (int i = 0; i < m; i += Format<Real>::width) {
      const V fall = -strided(T + i * stride + entering, stride);
      put(fall, column + i);
      most = larger(most, size_of(fall));
    }
    const Real floor = LemkeRules::pivot<Real> * largest_lane(most);
    const int leaving = leaving_row(work, column, floor, T, stride);
    if (leaving >= 0)
      take(leaving);
    else
      *outcome = RAY;
  }
  *steps = count;

  for (int i = 0; i < stride; ++i) work.z[i] = 0;
  for (int i = 0; i < m; ++i)
    if (work.basic[i] >= m && work.basic[i] < 2 * m) work.z[work.basic[i] - m] = values[i];
  refine<S>(work, [&](const Real* miss, Real* x) {
    for (int i = 0; i < m; ++i) {
      if (work.basic[i] < m || work.basic[i] == 2 * m) continue;
      Real sum = 0;
      for (int k = 0; k <= m; ++k) sum += work.nonbasic[k] < m ? T[i * stride + k] * miss[work.nonbasic[k]] : 0;
      x[work.basic[i] - m] -= sum;
    }
  });
  unscale(work.z.data(), work.unit.data(), units, m, z);

  // on a ray the entering variable grows by one and the basis by its column; y = -(its z part)
  for (int i = 0; i < m; ++i) certificate[i] = 0;
  if (*outcome != RAY) return;
  const int label = work.nonbasic[entering];
  for (int i = 0; i < m; ++i)
    if (work.basic[i] >= m && work.basic[i] < 2 * m) certificate[work.basic[i] - m] = T[i * stride + entering];
  if (label >= m && label < 2 * m) certificate[label - m] += 1;
  for (int i = 0; i < m; ++i) certificate[i] = -times_power_of_two(larger(certificate[i], Real(0)), units.rows[i]);
}

// A group of problems. A lane with a tie, a ray or a long path is left to `lemke`.
template <int m, class Real>
Ended<Real> lemke_lanes(GroupJudge<m, Real>& judge, const Real* covering, int budget, Workspace<Real>& work, Real* z,
                        Real* certificate, int* steps) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  constexpr int n = m + 1, longest = 8 * m;
  const Given<m, Real>& given = judge.given;
  const int count = given.count;
  Group<m, Real> group;
  load(given, group);
  V T[m][n], values[m], column[m];
  K basic[m], nonbasic[n], entering = K{} + m, alone{}, taken{}, going{};
  for (int i = 0; i < m; ++i) {
    values[i] = group.q[i];
    basic[i] = K{} + i;
    nonbasic[i] = K{} + (m + i);
    going |= ~(values[i] >= 0);
    for (int j = 0; j < m; ++j) T[i][j] = group.M[i][j];
    T[i][m] = all(Real(1));
    for (int lane = 0; covering && lane < count; ++lane) T[i][m][lane] = covering[lane * m + i];
    column[i] = T[i][m];
  }
  nonbasic[m] = K{} + 2 * m;
  for (int step = -1; step < longest && any_lane<Real>(going); ++step) {
    V floor{};  // the first exchange brings the artificial variable in: every row takes part, and it falls there
    if (step >= 0) {
      V most{};
      for (int i = 0; i < m; ++i) {
        column[i] = V{};
        for (int k = 0; k < n; ++k) column[i] = entering == k ? -T[i][k] : column[i];
        most = larger(most, size_of(column[i]));
      }
      floor = LemkeRules::pivot<Real> * most;
      taken -= going;
    }
    V ratio[m], least = all(infinity<Real>);
    for (int i = 0; i < m; ++i) {
      const K candidate = column[i] > floor;
      ratio[i] = candidate ? values[i] / (candidate ? column[i] : V{} + 1) : all(infinity<Real>);
      least = smaller(least, ratio[i]);
    }
    const V limit = least + LemkeRules::tie<Real> * (1 + size_of(least));
    K row = K{} - 1, artificial = K{} - 1, tied{};
    for (int i = m - 1; i >= 0; --i) {
      const K here = (ratio[i] <= limit) & (column[i] > floor);
      row = here ? K{} + i : row;
      artificial = here & (basic[i] == 2 * m) ? K{} + i : artificial;
      tied -= here;
    }
    row = artificial >= 0 ? artificial : row;
    const K open = (row < 0) | ((tied > 1) & (artificial < 0));
    alone |= going & open;
    going &= ~open;
    row = going ? row : K{} - 1;

    V across[n] = {}, value{};
    K left{}, new_label{};
    for (int i = 0; i < m; ++i) {
      const K here = row == i;
      for (int k = 0; k < n; ++k) across[k] = here ? T[i][k] : across[k];
      value = here ? values[i] : value;
      left = here ? basic[i] : left;
    }
    V pivot = V{} + 1;
    for (int k = 0; k < n; ++k) {
      pivot = going & (entering == k) ? across[k] : pivot;
      new_label = entering == k ? nonbasic[k] : new_label;
    }
    const V inverse = going ? 1 / pivot : V{}, change = value * inverse;
    for (int k = 0; k < n; ++k) across[k] *= inverse;
    const Real sign = step < 0 ? 1 : -1;  // the column as it stands in T
    for (int i = 0; i < m; ++i) {
      const K here = row == i;
      const V l = sign * column[i];
      for (int k = 0; k < n; ++k) {
        const V updated = T[i][k] - l * across[k];
        T[i][k] = here ? -across[k] : updated;
      }
      values[i] = here ? -change : values[i] - l * change;
      basic[i] = here ? new_label : basic[i];
    }
    const K complement = left < m ? left + m : left - m;
    K next{};
    for (int k = n - 1; k >= 0; --k) {
      const K here = going & (entering == k);
      for (int i = 0; i < m; ++i) T[i][k] = here ? (row == i ? inverse : sign * column[i] * inverse) : T[i][k];
      nonbasic[k] = here ? left : nonbasic[k];
      next = nonbasic[k] == complement ? K{} + k : next;
    }
    entering = going ? next : entering;
    going &= left != 2 * m;
  }
  alone |= going;
  const auto of_z = [&](const V(&x)[m], int j) {
    V sum{};
    for (int i = 0; i < m; ++i) sum += basic[i] == m + j ? x[i] : V{};
    return sum;
  };
  V found[m];
  for (int j = 0; j < m; ++j) found[j] = of_z(values, j);
  const auto correct = [&](const V(&miss)[m], V(&x)[m]) {
    V sums[m] = {};
    for (int k = 0; k < n; ++k) {
      V raised{};
      for (int j = 0; j < m; ++j) raised = nonbasic[k] == j ? miss[j] : raised;
      for (int i = 0; i < m; ++i) sums[i] += T[i][k] * raised;
    }
    for (int j = 0; j < m; ++j) x[j] -= of_z(sums, j);
  };
  conclude(group, judge, found, [&](K open) { return refine_lanes(group, open, found, REFINEMENTS, correct); }, z);
  write_integers<Real>(taken, count, steps);
  Ended<Real> ended{K{} + int(SOLVED), nullptr};
  if (budget >= longest && !any_lane<Real>(alone)) return ended;
  std::memset(certificate, 0, sizeof(Real) * m * count);
  ended.certificates = certificate;
  for (int lane = 0; lane < count; ++lane) {
    if (!alone[lane] && budget >= longest) continue;
    int outcome;
    lemke<0>(given.M + lane * m * m, given.q + lane * m, covering ? covering + lane * m : nullptr, budget, work,
             z + lane * m, certificate + lane * m, &outcome, steps + lane);
    ended.outcome[lane] = outcome;
  }
  judge.measure(z);
  return ended;
}

}  // namespace jaxcontact
