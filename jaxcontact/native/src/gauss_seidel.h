// Projected Gauss-Seidel, sweep for sweep as in complementarity/gauss_seidel.py.
#pragma once

#include "group_findings.h"

namespace jaxcontact {

// The budget, the relaxation, and the backward error at which a lane rests.
struct Sweeps {
  int most;
  double relaxation, target;
};

// A group of problems, measured as the judge measures them; start: (m) each, or null for zeros.
template <int m, class Real>
void gauss_seidel_lanes(const Given<m, Real>& given, const Real* start, const Sweeps& sweeps, Workspace<Real>& work,
                        Real* z, Real* certificate, int* steps, const Found<Real>& found) {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const int count = given.count;
  GroupJudge<m, Real> judge(given);
  V x[m] = {}, step[m];
  if (start) read_lanes<m>(start, count, x);
  for (int i = 0; i < m; ++i) {
    const K positive = given.A[i][i] > 0;
    step[i] = positive ? Real(sweeps.relaxation) / (positive ? given.A[i][i] : V{} + 1) : V{};
  }
  K taken{}, going = ~K{};
  for (int sweep = 0;; ++sweep) {
    judge.measure(x);
    going &= judge.whole & ~(judge.eta <= Real(sweeps.target));
    if (sweep == sweeps.most || !any_lane<Real>(going)) break;
    taken -= going;
    for (int i = 0; i < m; ++i) {
      V w = given.load[i];
      for (int j = 0; j < m; ++j) w += given.A[i][j] * x[j];
      x[i] = going ? cut(x[i] - step[i] * w) : x[i];
    }
  }
  write_lanes<m>(x, count, z);
  write_integers<Real>(taken, count, steps);
  const K outcome = going ? K{} + int(MAX_STEPS) : K{} + int(SOLVED);
  judge.write({outcome, hopeless_rows(given, certificate) ? certificate : nullptr}, z, work, found);
}

// One problem of any size.
template <int S, class Real>
void gauss_seidel(const Real* M, const Real* q, const Real* start, const Sweeps& sweeps, Workspace<Real>& work, Real* z,
                  Real* certificate, int* steps, const Found<Real>& found) {
  const int m = work.m, stride = S ? S : work.stride;
  const Real* rows = work.M.data();
  Real *x = work.z.data(), *step = work.values.data();
  prepare<S>(M, q, work);
  for (int i = 0; i < stride; ++i) x[i] = i < m && start ? start[i] : 0;
  for (int i = 0; i < m; ++i) step[i] = M[i * m + i] > 0 ? Real(sweeps.relaxation) / M[i * m + i] : 0;
  int outcome;
  for (*steps = 0;; ++*steps) {
    measure(at_point<S>(x, work), found);
    const bool going = is_finite(*found.eta) && !(*found.eta <= Real(sweeps.target));
    outcome = going ? MAX_STEPS : SOLVED;
    if (!going || *steps == sweeps.most) break;
    for (int i = 0; i < m; ++i) {
      Lanes<Real> sum{};
      for (int j = 0; j < stride; j += Format<Real>::width) sum += lanes_at(rows + i * stride + j) * lanes_at(x + j);
      const Real moved = x[i] - step[i] * (q[i] + sum_of_lanes(sum));
      x[i] = moved < 0 ? 0 : moved;
    }
  }
  for (int i = 0; i < m; ++i) z[i] = x[i];
  hopeless_row(M, q, m, certificate);
  tell<S>(M, at_point<S>(x, work), certificate, outcome, work, found);
}

}  // namespace jaxcontact
