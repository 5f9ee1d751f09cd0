// Principal pivoting: one problem step for step as in complementarity/principal.py, a group in turns first.
#pragma once

#include "group_findings.h"

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
  static constexpr bool fits = m > 2 && m <= 4;  // the registers of the widest kind; two contacts gain nothing
  V T[m][m], values[m];
  V floor_z = all(-PrincipalRules::negative<Real>), floor_w = floor_z;  // values below are negative
  K active[m] = {}, taken{}, solved{};

  // kept: the final tableau is wanted too.
  explicit Turns(const Group<m, Real>& group, bool kept) {
    if constexpr (!fits) {
      each<m>([&](auto i) {
        values[i] = group.q[i];
        each<m>([&](auto j) { T[i][j] = group.M[i][j]; });
      });
    }
    bool any = fits ? turns(group.M, group.q, kept) : turns(T, values, kept);
    for (int round = 1; round < PrincipalRules::quick && any && any_lane<Real>(~solved); ++round)
      any = turns(T, values, kept);
  }

  // A turn for each row, or two while the tableau is in registers; whether one was taken. The floors follow the values
  // from one call to the next, so that no turn has to wait for them.
  bool turns(const V (&from_T)[m][m], const V (&from_values)[m], bool kept) {
    bool any = false;
    if constexpr (fits) {
      V t[m][m], x[m];
      each<m>([&](auto i) {
        x[i] = from_values[i];
        each<m>([&](auto j) { t[i][j] = from_T[i][j]; });
      });
      each<2 * m>([&](auto k) { any |= turn<k % m>(t, x); });
      measure(x);
      each<m>([&](auto i) { values[i] = x[i]; });
      if (kept || any_lane<Real>(~solved)) each<m>([&](auto i) { each<m>([&](auto j) { T[i][j] = t[i][j]; }); });
    } else {
      each<m>([&](auto r) { any |= turn<r>(T, values); });
      measure(values);
    }
    return any;
  }

  JAXCONTACT_INLINE void measure(const V (&x)[m]) {
    V size_z{}, size_w = all(Real(1));
    for (int i = 0; i < m; ++i) {
      const V size = size_of(x[i]);
      size_w = larger(size_w, size);
      size_z = active[i] ? larger(size_z, size) : size_z;
    }
    floor_z = -PrincipalRules::negative<Real> * size_z, floor_w = -PrincipalRules::negative<Real> * size_w;
    solved = ~K{};
    for (int i = 0; i < m; ++i) solved &= ~negative(i, x[i]);
  }

  // body(i) for each row, each a constant where the tableau is in registers.
  template <class Body>
  static JAXCONTACT_INLINE void rows(Body body) {
    if constexpr (fits) {
      each<m>(body);
    } else {
      for (int i = 0; i < m; ++i) body(i);
    }
  }

  K negative(int i, V value) const { return value < (active[i] ? floor_z : floor_w); }

  template <int r>
  JAXCONTACT_INLINE bool turn(V (&t)[m][m], V (&x)[m]) {
    const V pivot = t[r][r];
    const K go = negative(r, x[r]) & (pivot > PrincipalRules::pivot<Real>);
    if (!any_lane<Real>(go)) return false;
    const V inverse = 1 / pivot;  // not used where the lane does not go
    V across[m];
    each<m>([&](auto j) { across[j] = t[r][j] * -inverse; });
    const V step = x[r] * -inverse;
    rows([&](auto i) {
      if (i == r) return;
      const V left = t[i][r];
      rows([&](auto j) {
        if (j != r) t[i][j] = go ? t[i][j] + left * across[j] : t[i][j];
      });
      t[i][r] = go ? left * inverse : left;
      x[i] = go ? x[i] + left * step : x[i];
    });
    each<m>([&](auto j) { t[r][j] = go ? across[j] : t[r][j]; });
    t[r][r] = go ? inverse : pivot;
    x[r] = go ? step : x[r];
    active[r] ^= go;
    taken -= go;
    return true;
  }
};

// `refine_lanes` by the final tableau of the turns, which are taken again for it: it is seldom asked for, and what
// would have to be kept for it is most of what turns write.
template <int m, class Real>
__attribute__((noinline)) Masks<Real> refine_turns(const Given<m, Real>& given, Masks<Real> open, Lanes<Real> (&z)[m]) {
  using V = Lanes<Real>;
  Group<m, Real> group;
  load(given, group);
  const Turns<m, Real> turns(group, true);
  return refine_lanes(group, open, z, REFINEMENTS, [&turns](const V(&miss)[m], V(&x)[m]) {
    for (int i = 0; i < m; ++i) {
      V sum{};
      for (int j = 0; j < m; ++j) sum += turns.active[j] ? turns.T[i][j] * miss[j] : V{};
      x[i] -= turns.active[i] ? sum : V{};
    }
  });
}

// A group of problems without warm start. A lane that turns do not solve, or not well, is left to `principal`.
template <int m, class Real>
Ended<Real> principal_lanes(GroupJudge<m, Real>& judge, int budget, Workspace<Real>& work, Real* z, Real* certificate,
                            int* steps) {
  using K = Masks<Real>;
  const Given<m, Real>& given = judge.given;
  const int count = given.count;
  Lanes<Real> found[m];
  Group<m, Real> group;
  load(given, group);
  const Turns<m, Real> turns(group, false);
  for (int i = 0; i < m; ++i) found[i] = turns.active[i] ? turns.values[i] : Lanes<Real>{};
  const K taken = turns.taken;
  K left = ~turns.solved | (taken > budget);
  left |= conclude(group, judge, found, [&](K open) { return refine_turns<m, Real>(given, open, found); }, z);
  write_integers<Real>(taken, count, steps);
  Ended<Real> ended{K{} + int(SOLVED), nullptr};
  if (!any_lane<Real>(left)) return ended;
  std::memset(certificate, 0, sizeof(Real) * m * count);
  ended.certificates = certificate;
  for (int lane = 0; lane < count; ++lane) {
    if (!left[lane]) continue;
    int outcome;
    principal<padded<Real>(m)>(given.M + lane * m * m, given.q + lane * m, nullptr, budget, work, z + lane * m,
                               certificate + lane * m, &outcome, steps + lane);
    ended.outcome[lane] = outcome;
  }
  judge.measure(z);
  return ended;
}

}  // namespace jaxcontact
