// What the judge asks of a point, as bits of a number, and its truth table: complementarity/judge.py.
#pragma once

#include "condition.h"

namespace jaxcontact {

// PROVED: the certificate excludes a feasible point; DEPENDENT: no mode is regular (of pairs); SMALL, TELLING, CLOSE:
// eta and rho are within these bounds. A certificate is looked at where eta and rho are not both clear, the condition
// of the mode (MODERATE) where eta is small and rho does not tell.
enum Flags : int {
  DATA_FINITE = 1,
  POINT_FINITE = 2,
  PROVED = 4,
  DEPENDENT = 8,
  SMALL = 16,
  TELLING = 32,
  CLOSE = 64,
  MODERATE = 128
};

template <class Real>
inline Masks<Real> bounds_held(Lanes<Real> eta, Lanes<Real> rho) {
  return ((eta <= JudgeRules::backward_error<Real>)&int(SMALL)) | ((rho <= JudgeRules::telling<Real>)&int(TELLING)) |
         ((eta <= JudgeRules::close<Real>)&int(CLOSE));
}

template <class Real>
inline int bounds_held(Real eta, Real rho) {
  return (eta <= JudgeRules::backward_error<Real> ? SMALL : 0) | (rho <= JudgeRules::telling<Real> ? TELLING : 0) |
         (eta <= JudgeRules::close<Real> ? CLOSE : 0);
}

// An answer within both bounds needs neither certificate nor condition.
template <class Real, class N>
inline auto clear(N eta, N rho) {
  return (eta <= JudgeRules::backward_error<Real>)&(rho <= JudgeRules::telling<Real>);
}

// `_status` of judge.py.
inline int status_of(int flags, int outcome) {
  const bool claims = outcome == SOLVED, proposes = claims || outcome == NO_SOLUTION;
  if (!(flags & DATA_FINITE) || (proposes && !(flags & POINT_FINITE))) return BAD_INPUT;
  if (flags & SMALL && flags & (TELLING | MODERATE)) return flags & DEPENDENT ? REDUNDANT : SOLVED;
  if (flags & PROVED) return INFEASIBLE;
  if (claims || (proposes && flags & CLOSE)) return flags & SMALL ? ILL_CONDITIONED : INACCURATE;
  return outcome;
}

// What a kernel tells of each problem in one number.
enum class Tells { STATUS, OUTCOME, FLAGS };

inline int told(Tells what, int flags, int outcome) {
  return what == Tells::FLAGS ? flags : what == Tells::OUTCOME ? outcome : status_of(flags, outcome);
}

// Where one problem's results go.
template <class Real>
struct Found {
  Real *eta, *rho;
  int* told;
  Tells what;

  Found at(int64_t b) const { return {eta + b, rho + b, told + b, what}; }
};

// How a method ended in each lane of a group, and its certificates; null if all are zero.
template <class Real>
struct Ended {
  Masks<Real> outcome;
  const Real* certificates;
};

}  // namespace jaxcontact
