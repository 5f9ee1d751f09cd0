// `findings.h` for a group of problems, one to a lane.
#pragma once

#include "findings.h"

namespace jaxcontact {

// A group of problems as the judge sees them: the caller's numbers, and units that make rows comparable.
template <int m, class Real>
struct GroupJudge {
  using V = Lanes<Real>;
  using K = Masks<Real>;
  const Given<m, Real>& given;
  V t[m], up[m], down[m];
  V x[m], w[m], terms[m], eta, rho;
  K whole, sound;  // the point is finite, the data are

  explicit GroupJudge(const Given<m, Real>& given) : given(given) {
    for (int i = 0; i < m; ++i) {
      t[i] = given.A[i][i];
      up[i] = powers_of_two<Real>(given.rows[i]);
      down[i] = powers_of_two<Real>(-given.rows[i]);
    }
    if (!any_lane<Real>(~given.plain)) return;
    for (int lane = 0; lane < given.count; ++lane) {
      if (given.plain[lane]) continue;
      int own[m];
      const Real* M = given.M + lane * m * m;
      row_exponents(M, m, own);
      for (int i = 0; i < m; ++i) {
        t[i][lane] = stiffness_of(M + i * m, i, m);
        up[i][lane] = power_of_two<Real>(own[i]);
        down[i][lane] = power_of_two<Real>(-own[i]);
      }
    }
  }

  JAXCONTACT_INLINE Point<V> at(const V (&z)[m]) {
    for (int i = 0; i < m; ++i) {
      x[i] = z[i];
      w[i] = given.load[i];
      terms[i] = size_of(w[i]);
      for (int j = 0; j < m; ++j) {
        const V product = given.A[i][j] * z[j];
        w[i] += product;
        terms[i] += size_of(product);
      }
    }
    return {m, given.load, x, w, terms, t, up, down};
  }

  // Lanes where every row of the point of `at` misses by no more than EXACT eps of its own terms.
  JAXCONTACT_INLINE K settled() const {
    K all_rows = ~K{};
    for (int i = 0; i < m; ++i) {
      const V allowed = EXACT * eps<Real> * terms[i];
      all_rows &= (w[i] >= -allowed) & ((x[i] <= 0) | (w[i] <= allowed));
    }
    return all_rows;
  }

  void measure(const V (&z)[m]) { measure(at(z)); }

  void measure(const Real* z) {
    V own[m];
    read_lanes<m>(z, given.count, own);
    measure(own);
  }

  JAXCONTACT_INLINE void measure(const Point<V>& at_z) {
    at_z.errors(&eta, &rho);
    V sum{}, point{}, data{};
    for (const V& part : terms) sum += part;
    sound = whole = sum - sum == 0;  // no number is lost in a sum of sizes
    if (!any_lane<Real>(~sound)) return;
    for (int i = 0; i < m; ++i) {
      point += x[i] - x[i] + (w[i] - w[i]);  // zero, or NaN
      data += given.load[i] - given.load[i];
      for (int j = 0; j < m; ++j) data += given.A[i][j] - given.A[i][j];
    }
    whole = point == 0, sound = data == 0;
    eta = whole ? eta : all(not_a_number<Real>);  // comparisons above may have dropped it
    rho = whole ? rho : all(not_a_number<Real>);
  }

  // What was measured last, of the points z; where a lane is not clear, seldom, it is looked at by itself.
  void write(const Ended<Real>& ended, const Real* z, Workspace<Real>& work, const Found<Real>& found) const {
    const int count = given.count;
    write_lanes<1>(&eta, count, found.eta);
    write_lanes<1>(&rho, count, found.rho);
    const K flags = (sound & int(DATA_FINITE)) | (whole & int(POINT_FINITE)) | bounds_held<Real>(eta, rho);
    K tells = found.what == Tells::FLAGS ? flags : found.what == Tells::OUTCOME ? ended.outcome : K{} + int(SOLVED);
    const K open = ~(clear<Real>(eta, rho) & sound & whole);
    if (found.what != Tells::OUTCOME && any_lane<Real>(open))
      for (int lane = 0; lane < count; ++lane)
        if (open[lane])
          tells[lane] = told(found.what, int(flags[lane]) | seen(ended, z, lane, work), ended.outcome[lane]);
    write_integers<Real>(tells, count, found.told);
  }

  // PROVED and MODERATE of one lane.
  __attribute__((noinline)) int seen(const Ended<Real>& ended, const Real* z, int lane, Workspace<Real>& work) const {
    const Real *M = given.M + lane * m * m, *q = given.q + lane * m, *identity = nullptr;
    if (clear<Real>(eta[lane], rho[lane])) return 0;
    const bool small = eta[lane] <= JudgeRules::backward_error<Real>;
    const int flags = small && moderate(M, q, z + lane * m, work) ? MODERATE : 0;
    if (!ended.certificates) return flags;
    Real unit_z[m], unit_w[m];
    for (int i = 0; i < m; ++i) unit_z[i] = down[i][lane], unit_w[i] = up[i][lane];
    return proves(M, identity, q, ended.certificates + lane * m, m, unit_z, unit_w) ? flags | PROVED : flags;
  }
};

// z of a group in balanced units is cut to z >= 0, written and measured. Where lanes are not settled, seldom,
// refine(them) corrects z; the lanes where it is still not close are returned, by `refine` too.
template <int m, class Real, class Refine>
inline Masks<Real> conclude(const Group<m, Real>& group, GroupJudge<m, Real>& judge, Lanes<Real> (&z)[m], Refine refine,
                            Real* to) {
  Lanes<Real> x[m];
  const auto point = [&] {
    for (int i = 0; i < m; ++i) x[i] = cut(z[i]) * group.unit[i] * group.whole;
    return judge.at(x);
  };
  Point<Lanes<Real>> found = point();
  Masks<Real> open = ~judge.settled();
  if (any_lane<Real>(open)) {
    open = refine(open);
    found = point();
  }
  judge.measure(found);
  write_lanes<m>(x, judge.given.count, to);
  return open;
}

template <int m, class Real>
void classes_of_group(const Given<m, Real>& given, const Real* z, const Classes<Real>& to) {
  Lanes<Real> x[m];
  Masks<Real> active[m], degenerate[m];
  GroupJudge<m, Real> judge(given);
  read_lanes<m>(z, given.count, x);
  judge.at(x).classes([&](int i, Masks<Real> a, Masks<Real> d) { active[i] = a, degenerate[i] = d; });
  write_lanes<m>(judge.w, given.count, to.w);
  write_masks<m, Real>(active, given.count, to.active);
  write_masks<m, Real>(degenerate, given.count, to.degenerate);
}

}  // namespace jaxcontact
