// Principal pivoting, step for step as in complementarity/principal.py.
#pragma once

#include "group.h"

namespace jaxcontact {

struct PrincipalRules {
  static constexpr int quick = 8;
  template <class Real>
  static constexpr Real negative = (sizeof(Real) == 8 ? 64 : 16) * eps<Real>;
  template <class Real>
  static constexpr Real pivot = (sizeof(Real) == 8 ? 64 : 8) * eps<Real>;
};

// The row to pivot next, or -1 where no value is negative; `stuck` where all negative rows are barred.
template <int S, class Real>
inline int choose_row(const Workspace<Real>& work, bool quick, bool* stuck) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  constexpr int W = Format<Real>::width;
  const int stride = S ? S : work.stride;
  const Real* values = work.values.data();
  const auto mask_at = [](const auto& x, int j) {
    K mask;
    std::memcpy(&mask, x.data() + j, sizeof mask);
    return mask;
  };
  V size_z{}, size_w = all(Real(1));
  for (int j = 0; j < stride; j += W) {
    const V size = size_of(lanes_at(values + j));
    size_w = larger(size_w, size);
    size_z = larger(size_z, mask_at(work.active, j) ? size : V{});
  }
  const V floor_z = all(-PrincipalRules::negative<Real> * largest_lane(size_z));
  const V floor_w = all(-PrincipalRules::negative<Real> * largest_lane(size_w));
  K index, first = K{} + work.m, blocked = first;
  for (int k = 0; k < W; ++k) index[k] = k;
  V lowest{};
  for (int j = 0; j < stride; j += W, index += W) {
    const V value = lanes_at(values + j);
    const K negative = value < (mask_at(work.active, j) ? floor_z : floor_w), barred = mask_at(work.barred, j);
    const V depth = negative & ~barred ? (quick ? value : V{} - 1) : V{};
    first = depth < lowest ? index : first;
    lowest = smaller(lowest, depth);
    blocked = negative & barred & (blocked > index) ? index : blocked;
  }
  const Real least = smallest_lane(lowest);
  *stuck = false;
  if (least < 0) return int(smallest_lane(lowest == all(least) ? first : K{} + work.m));
  const int row = int(smallest_lane(blocked));
  *stuck = row < work.m;
  return *stuck ? row : -1;
}

// One problem. wanted: rows of a warm start, or null; certificate (m) is written for a stuck row, zeros otherwise.
template <int S, class Real>
void principal(const Real* M, const Real* q, const bool* wanted, int budget, Workspace<Real>& work, Real* z,
               Real* certificate, int* outcome, int* steps) {
  const int m = work.m, stride = S ? S : work.stride;
  Real* T = work.T.data();
  const Units units = scaled<S>(M, q, m, stride, work.rows.data(), work.unit.data(), work.M.data(), work.q.data());
  std::memcpy(T, work.M.data(), sizeof(Real) * m * stride);
  std::memcpy(work.values.data(), work.q.data(), sizeof(Real) * stride);
  for (int i = 0; i < stride; ++i) work.active[i] = work.barred[i] = 0;
  char* pending = work.tied.data();
  for (int i = 0; i < m; ++i) pending[i] = wanted && wanted[i];
  int warm = wanted ? 0 : m, count = 0, row = -1;
  *outcome = MAX_STEPS;
  for (;;) {
    while (warm < m && !pending[warm]) ++warm;
    bool stuck = false;
    row = warm < m ? warm : choose_row<S>(work, count < PrincipalRules::quick * m, &stuck);
    if (row < 0 || stuck) *outcome = stuck ? INACCURATE : SOLVED;
    if (row < 0 || stuck || count >= budget) break;
    ++count;
    if (warm < m) pending[warm] = 0;
    const Real* across = T + row * stride;
    if (across[row] > PrincipalRules::pivot<Real> * largest_of(across, stride)) {
      exchange<S>(T, work.values.data(), work.column.data(), work.right.data(), m, stride, row, row);
      work.active[row] ^= -1;
      for (int i = 0; i < stride; ++i) work.barred[i] = 0;
    } else {
      work.barred[row] = -1;
    }
  }
  *steps = count;
  for (int i = 0; i < stride; ++i) work.z[i] = work.active[i] ? work.values[i] : 0;
  refine<S>(work, [&](const Real* miss, Real* x) {
    for (int i = 0; i < m; ++i) {
      if (!work.active[i]) continue;
      Real sum = 0;
      for (int j = 0; j < m; ++j) sum += work.active[j] ? T[i * stride + j] * miss[j] : 0;
      x[i] -= sum;
    }
  });
  unscale(work.z.data(), work.unit.data(), units, m, z);
  for (int i = 0; i < m; ++i) certificate[i] = 0;
  if (*outcome != INACCURATE) return;
  for (int i = 0; i < m; ++i) {  // the row is y'(w - M z) = y'q with y >= 0, if it has no positive entry
    const Real y = (i == row && !work.active[i]) - (work.active[i] ? T[row * stride + i] : 0);
    certificate[i] = -times_power_of_two(larger(y, Real(0)), units.rows[i]);
  }
}

// A group of problems without warm start.
template <int m, class Real>
void principal_lanes(const Given<m, Real>& given, int budget, Real* z, Real* certificate, int* outcome, int* steps) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const int count = given.count;
  Group<m, Real> group;
  load(given, group);
  V T[m][m], values[m];
  K active[m] = {}, barred[m] = {}, taken{}, ended = K{} + int(MAX_STEPS), stuck{};
  for (int i = 0; i < m; ++i) {
    values[i] = group.q[i];
    for (int j = 0; j < m; ++j) T[i][j] = group.M[i][j];
  }
  for (int count_of_steps = 0;; ++count_of_steps) {
    V size_z{}, size_w = all(Real(1));
    for (int i = 0; i < m; ++i) {
      const V size = size_of(values[i]);
      size_w = larger(size_w, size);
      size_z = active[i] ? larger(size_z, size) : size_z;
    }
    const V floor_z = -PrincipalRules::negative<Real> * size_z, floor_w = -PrincipalRules::negative<Real> * size_w;
    const bool quick = count_of_steps < PrincipalRules::quick * m;
    V lowest{};
    K row = K{} - 1, blocked = K{} - 1;
    for (int i = m - 1; i >= 0; --i) {
      const K negative = values[i] < (active[i] ? floor_z : floor_w), free = negative & ~barred[i];
      const K first = free & (quick ? values[i] <= lowest : free);
      lowest = first ? values[i] : lowest;
      row = first ? K{} + i : row;
      blocked = negative & barred[i] ? K{} + i : blocked;
    }
    const K going = ended == int(MAX_STEPS), none = row < 0;
    stuck = going & none ? blocked : stuck;
    ended = going & none ? (blocked < 0 ? K{} + int(SOLVED) : K{} + int(INACCURATE)) : ended;
    const K now = ended == int(MAX_STEPS);
    if (!any_lane<Real>(now) || count_of_steps >= budget) break;
    row = now ? row : K{} - 1;
    taken -= now;

    V across[m] = {}, column[m] = {}, value{}, pivot{}, most{};
    for (int i = 0; i < m; ++i) {
      const K here = row == i;
      for (int j = 0; j < m; ++j) across[j] = here ? T[i][j] : across[j];
      for (int j = 0; j < m; ++j) column[j] = here ? T[j][i] : column[j];
      pivot = here ? T[i][i] : pivot;
      value = here ? values[i] : value;
    }
    for (int j = 0; j < m; ++j) most = larger(most, size_of(across[j]));
    const K go = now & (pivot > PrincipalRules::pivot<Real> * most);
    const V inverse = go ? 1 / (go ? pivot : V{} + 1) : V{}, step = value * inverse;
    for (int j = 0; j < m; ++j) across[j] *= inverse;
    for (int i = 0; i < m; ++i) {
      const K here = go & (row == i);
      for (int j = 0; j < m; ++j) {
        const V updated = T[i][j] - column[i] * across[j];
        T[i][j] = here ? -across[j] : updated;
      }
      values[i] = here ? -step : values[i] - column[i] * step;
      active[i] ^= here;
      barred[i] = (barred[i] & ~go) | (now & ~go & (row == i));
    }
    for (int j = 0; j < m; ++j) {
      const K here = go & (row == j);
      for (int i = 0; i < m; ++i) T[i][j] = here ? column[i] * inverse : T[i][j];
      T[j][j] = here ? inverse : T[j][j];
    }
  }
  V found[m];
  for (int i = 0; i < m; ++i) found[i] = active[i] ? values[i] : V{};
  refine_lanes<m, Real>(group, found, REFINEMENTS, [&](const V(&miss)[m], V(&x)[m]) {
    for (int i = 0; i < m; ++i) {
      V sum{};
      for (int j = 0; j < m; ++j) sum += active[j] ? T[i][j] * miss[j] : V{};
      x[i] -= active[i] ? sum : V{};
    }
  });
  scatter(group, found, count, z);
  write_integers<Real>(ended, count, outcome);
  write_integers<Real>(taken, count, steps);
  std::memset(certificate, 0, sizeof(Real) * m * count);
  if (!any_lane<Real>(ended == int(INACCURATE))) return;
  for (int lane = 0; lane < count; ++lane) {
    if (outcome[lane] != INACCURATE) continue;
    int rows[m];  // as in `principal`
    row_exponents(given.M + lane * m * m, m, rows);
    for (int i = 0; i < m; ++i) {
      Real across = 0;
      for (int k = 0; k < m; ++k) across = k == stuck[lane] ? T[k][i][lane] : across;
      const Real y = (i == stuck[lane] && !active[i][lane]) - (active[i][lane] ? across : 0);
      certificate[lane * m + i] = -times_power_of_two(larger(y, Real(0)), rows[i]);
    }
  }
}

}  // namespace jaxcontact
