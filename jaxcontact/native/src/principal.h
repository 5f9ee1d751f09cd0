// Principal pivoting: one problem step for step as in complementarity/principal.py, a group in turns first.
#pragma once

#include "findings.h"

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
  V size_z{}, size_w = all(Real(1)), lowest{};
  for (int j = 0; j < stride; j += W) {
    const V value = lanes_at(values + j), size = size_of(value);
    size_w = larger(size_w, size);
    size_z = larger(size_z, masks_at(&work.active[j]) ? size : V{});
    lowest = smaller(masks_at(&work.barred[j]) ? V{} : value, lowest);
  }
  const Real least = smallest_lane(lowest);
  const Real floor_z = -PrincipalRules::negative<Real> * largest_lane(size_z);
  const Real floor_w = -PrincipalRules::negative<Real> * largest_lane(size_w);
  *stuck = false;
  if (quick && least < smaller(floor_z, floor_w))
    for (int j = 0; j < stride; j += W) {
      const K here = (lanes_at(values + j) == least) & ~masks_at(&work.barred[j]);
      if (any_lane<Real>(here)) return j + first_lane<Real>(here);
    }
  int first = -1, blocked = -1;
  for (int i = work.m - 1; i >= 0; --i) {
    if (!(values[i] < (work.active[i] ? floor_z : floor_w))) continue;
    if (work.barred[i])
      blocked = i;
    else if (first < 0 || !quick || values[i] <= values[first])
      first = i;
  }
  *stuck = first < 0 && blocked >= 0;
  return *stuck ? blocked : first;
}

// One problem. wanted: rows of a warm start, or null; certificate (m) is written for a stuck row, zeros otherwise.
template <int S, class Real>
void principal(const Real* M, const Real* q, const bool* wanted, int budget, Workspace<Real>& work, Real* z,
               Real* certificate, int* outcome, int* steps) {
  using V = Lanes<Real>;
  constexpr int W = Format<Real>::width;
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
      exchange<S>(T, work.values.data(), work.right.data(), m, stride, row, row);
      for (int i = 0; i < stride; ++i) work.active[i] ^= -(i == row), work.barred[i] = 0;
    } else {
      work.barred[row] = -1;
    }
  }
  *steps = count;
  for (int i = 0; i < stride; ++i) work.z[i] = work.active[i] ? work.values[i] : 0;
  refine<S>(work, [&](const Real* miss, Real* x) {
    Real* held = work.right.data();
    for (int i = 0; i < stride; ++i) held[i] = work.active[i] ? miss[i] : 0;
    for (int i = 0; i < stride; i += W) {
      const V sums = sums_of_rows<S>(T, held, stride, i, product_of<V>);
      put(lanes_at(x + i) - (masks_at(&work.active[i]) ? sums : V{}), x + i);
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

// A group of problems whose rows take turns, so that all lanes pivot the same row and none has to be looked for. It is
// quick, not careful: what it finds is checked, and a lane that it does not solve is left.
template <int m, class Real>
struct Turns {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  V T[m][m], values[m], floor_z, floor_w;  // below these a value of z, of w, is negative
  K active[m] = {}, taken{};

  explicit Turns(const Group<m, Real>& group) {
    for (int i = 0; i < m; ++i) {
      values[i] = group.q[i];
      for (int j = 0; j < m; ++j) T[i][j] = group.M[i][j];
    }
    for (int round = 0; round < PrincipalRules::quick; ++round) {
      floors();
      if (!turns(std::make_integer_sequence<int, m>{})) return;
    }
  }

  void floors() {
    V size_z{}, size_w = all(Real(1));
    for (int i = 0; i < m; ++i) {
      const V size = size_of(values[i]);
      size_w = larger(size_w, size);
      size_z = active[i] ? larger(size_z, size) : size_z;
    }
    floor_z = -PrincipalRules::negative<Real> * size_z, floor_w = -PrincipalRules::negative<Real> * size_w;
  }

  K negative(int i) const { return values[i] < (active[i] ? floor_z : floor_w); }

  K solved() {
    K any{};
    floors();
    for (int i = 0; i < m; ++i) any |= negative(i);
    return ~any;
  }

  // One turn for each row; whether one was taken.
  template <int... r>
  bool turns(std::integer_sequence<int, r...>) {
    return (turn<r>() | ...);
  }

  template <int r>
  bool turn() {
    const V pivot = T[r][r];
    const K go = negative(r) & (pivot > PrincipalRules::pivot<Real>);
    if (!any_lane<Real>(go)) return false;
    const V inverse = 1 / pivot;  // not used where the lane does not go
    V across[m];
    for (int j = 0; j < m; ++j) across[j] = T[r][j] * -inverse;
    const V step = values[r] * -inverse;
    for (int i = 0; i < m; ++i) {
      if (i == r) continue;
      const V left = T[i][r];
      for (int j = 0; j < m; ++j)
        if (j != r) T[i][j] = go ? T[i][j] + left * across[j] : T[i][j];
      T[i][r] = go ? left * inverse : left;
      values[i] = go ? values[i] + left * step : values[i];
    }
    for (int j = 0; j < m; ++j) T[r][j] = go ? across[j] : T[r][j];
    T[r][r] = go ? inverse : pivot;
    values[r] = go ? step : values[r];
    active[r] ^= go;
    taken -= go;
    return true;
  }
};

// A group of problems without warm start. A lane that turns do not solve, or not well, is left to `principal`.
template <int m, class Real>
void principal_lanes(GroupJudge<m, Real>& judge, int budget, Workspace<Real>& work, Real* z, Real* certificate,
                     int* outcome, int* steps) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const Given<m, Real>& given = judge.given;
  const int count = given.count;
  Group<m, Real> group;
  load(given, group);
  Turns<m, Real> turns(group);
  V found[m];
  for (int i = 0; i < m; ++i) found[i] = turns.active[i] ? turns.values[i] : V{};
  K left = ~turns.solved() | (turns.taken > budget);
  left |= conclude(
      group, judge, found, REFINEMENTS,
      [&turns](const V(&miss)[m], V(&x)[m]) {
        for (int i = 0; i < m; ++i) {
          V sum{};
          for (int j = 0; j < m; ++j) sum += turns.active[j] ? turns.T[i][j] * miss[j] : V{};
          x[i] -= turns.active[i] ? sum : V{};
        }
      },
      z);
  write_integers<Real>(K{} + int(SOLVED), count, outcome);
  write_integers<Real>(turns.taken, count, steps);
  std::memset(certificate, 0, sizeof(Real) * m * count);
  if (!any_lane<Real>(left)) return;
  for (int lane = 0; lane < count; ++lane)
    if (left[lane])
      principal<padded<Real>(m)>(given.M + lane * m * m, given.q + lane * m, nullptr, budget, work, z + lane * m,
                                 certificate + lane * m, outcome + lane, steps + lane);
  judge.measure(z);
}

}  // namespace jaxcontact
