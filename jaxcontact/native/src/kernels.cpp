// The kernels as XLA calls them: batches along the leading axes, cut into pieces for XLA's own threads.
#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <type_traits>
#include <utility>

#include "condition.h"
#include "direct.h"
#include "gauss_seidel.h"
#include "lemke.h"
#include "pairs.h"
#include "principal.h"
#include "xla/ffi/api/ffi.h"

namespace ffi = xla::ffi;

namespace jaxcontact {

// Problems are handed out in pieces of about this many numbers of data: thirty microseconds of work or more, since what
// is read ahead of a piece begins anew with each.
constexpr int64_t PIECE = 1 << 14;

// An iteration passes over its data more often than a pivoting method.
constexpr int64_t SWEEPS_PER_PIECE = 8;

// Matrices of up to AHEAD_LIMIT contacts are asked for AHEAD groups before they are needed; larger ones would take the
// place of what is still in use.
constexpr int AHEAD = 2, AHEAD_LIMIT = 5;

// So many pieces are worth a pause of some fifty microseconds.
constexpr int64_t MANY = 8;

// begin()(first, last) over pieces of [0, total) on all threads of the pool and this one; each thread begins once. It
// waits only for pieces that have begun, so that a full pool cannot stop it.
template <class Begin>
void in_pieces(ffi::ThreadPool& pool, int64_t total, int64_t per_problem, int64_t grain, Begin begin) {
  int64_t length = (PIECE / per_problem + grain - 1) / grain * grain;
  length = length < grain ? grain : length;
  const int64_t count = (total + length - 1) / length;
  if (count <= 1) return begin()(0, total);
  struct Shared {
    std::atomic<int64_t> next{0}, done{0};
    std::atomic<bool> helped{false};
  };
  auto shared = std::make_shared<Shared>();
  auto take = [shared, total, length, count](auto& run) {
    const int64_t k = shared->next.fetch_add(1);
    if (k >= count) return false;
    run(k * length, (k + 1) * length < total ? (k + 1) * length : total);
    shared->done.fetch_add(1, std::memory_order_release);
    return true;
  };
  auto help = [shared, take, begin, count] {
    shared->helped = true;
    if (shared->next >= count) return;
    auto run = begin();
    while (take(run)) continue;
  };
  const int64_t helpers = pool.num_threads() < count ? pool.num_threads() : count;
  for (int64_t k = 1; k < helpers; ++k) pool.Schedule(decltype(help)(help));
  auto run = begin();
  take(run);
  // A helper may have been woken on this very core, behind this thread, and stay there for a millisecond while another
  // core is idle. The scheduler looks for an idle one again when a thread wakes up.
  if (helpers > 1 && count > MANY && !shared->helped) std::this_thread::sleep_for(std::chrono::microseconds(1));
  while (take(run)) continue;
  while (shared->done.load(std::memory_order_acquire) < count) std::this_thread::yield();
}

// Row lengths that the compiler knows, so that a row is a few registers.
template <class Real, class Body>
inline void with_stride(int stride, Body body) {
  constexpr int W = Format<Real>::width;
  if (stride == W) return body(std::integral_constant<int, W>{});
  if (stride == 2 * W) return body(std::integral_constant<int, 2 * W>{});
  if (stride == 3 * W) return body(std::integral_constant<int, 3 * W>{});
  if (stride == 4 * W) return body(std::integral_constant<int, 4 * W>{});
  if (stride == 5 * W) return body(std::integral_constant<int, 5 * W>{});
  if constexpr (W < 8) {
    if (stride == 6 * W) return body(std::integral_constant<int, 6 * W>{});
    if (stride == 8 * W) return body(std::integral_constant<int, 8 * W>{});
  }
  return body(std::integral_constant<int, 0>{});
}

// As many contacts as fit a group.
template <class Body>
inline void with_few_contacts(int m, Body body) {
  if (m == 1) return body(std::integral_constant<int, 1>{});
  if (m == 2) return body(std::integral_constant<int, 2>{});
  if (m == 3) return body(std::integral_constant<int, 3>{});
  if (m == 4) return body(std::integral_constant<int, 4>{});
  if (m == 5) return body(std::integral_constant<int, 5>{});
  if (m == 6) return body(std::integral_constant<int, 6>{});
  if (m == 7) return body(std::integral_constant<int, 7>{});
  if (m == 8) return body(std::integral_constant<int, 8>{});
}

using Real = JAXCONTACT_REAL;  // double or float: the file is compiled once for each
constexpr int64_t W = Format<Real>::width, LINE = 64 / sizeof(Real);

constexpr ffi::DataType number = sizeof(Real) == 8 ? ffi::F64 : ffi::F32;
using Numbers = ffi::Buffer<number>;
using Booleans = ffi::Buffer<ffi::PRED>;
using ToNumbers = ffi::Result<Numbers>;
using ToBooleans = ffi::Result<Booleans>;
using ToIntegers = ffi::Result<ffi::Buffer<ffi::S32>>;

template <class Vectors>
inline int contacts(const Vectors& q) {
  return int(q.dimensions().back());
}

template <class Vectors>
inline int64_t problems(const Vectors& q) {
  return q.element_count() / contacts(q);
}

// Where results go: what a method says of a problem, and what is measured of it while it is still at hand.
struct Results {
  Real *z, *certificate;  // no certificate: it is only looked at
  int32_t* steps;
  Found<Real> found;
  int64_t m;

  Real* certificate_at(int64_t b, Workspace<Real>& work) const {
    return certificate ? certificate + b * m : work.certificate.data();
  }
  // For a group that may write none: zeros, if anybody sees them.
  Real* certificates_at(int64_t b, int count, Workspace<Real>& work) const {
    if (certificate) std::memset(certificate + b * m, 0, sizeof(Real) * m * count);
    return certificate_at(b, work);
  }
};

// All problems, pieces of them in parallel: of_group(size, b, count, work) for problems that fit a group, else
// alone(stride, b, work) one by one.
template <class OfGroup, class Alone>
ffi::Error over_problems(ffi::ThreadPool& pool, int64_t total, int64_t m, int64_t weight, bool grouped, int extra,
                         OfGroup of_group, Alone alone) {
  in_pieces(pool, total, m * m * weight, grouped ? W : 1, [=] {
    return [=, work = Workspace<Real>(int(m), extra)](int64_t first, int64_t last) mutable {
      if (grouped) {
        with_few_contacts(int(m), [&](auto size) {
          for (int64_t b = first; b < last; b += W) of_group(size, b, int(last - b < W ? last - b : W), work);
        });
        return;
      }
      with_stride<Real>(work.stride, [&](auto stride) {
        for (int64_t b = first; b < last; ++b) alone(stride, b, work);
      });
    };
  });
  return ffi::Error::Success();
}

// All problems by a method, each measured: of_group(judge, b, work) says how it `Ended` and leaves the
// measures in the judge; alone(stride, b, work, certificate) says its outcome and is measured behind it.
template <class OfGroup, class Alone>
ffi::Error solved(ffi::ThreadPool& pool, Numbers& M_, Numbers& q_, const Results& to, bool grouped, int extra,
                  OfGroup of_group, Alone alone) {
  const int64_t m = to.m;
  const Real *M = M_.typed_data(), *q = q_.typed_data();
  return over_problems(
      pool, problems(q_), m, 1, grouped, extra,
      [=](auto size, int64_t b, int count, Workspace<Real>& work) {
        if constexpr (size() <= AHEAD_LIMIT)
          for (int64_t k = 0; k < W * m * m; k += LINE) __builtin_prefetch(M + (b + AHEAD * W) * m * m + k);
        const Given<size(), Real> given(M + b * m * m, q + b * m, count);
        GroupJudge<size(), Real> judge(given);
        const Ended<Real> ended = of_group(judge, b, work);
        judge.write(ended, to.z + b * m, work, to.found.at(b));
      },
      [=](auto stride, int64_t b, Workspace<Real>& work) {
        Real* certificate = to.certificate_at(b, work);
        const int outcome = alone(stride, b, work, certificate);
        findings<stride()>(M + b * m * m, q + b * m, to.z + b * m, certificate, outcome, work, to.found.at(b));
      });
}

#define JAXCONTACT_RESULTS \
  ToNumbers z, ToNumbers certificate, ToIntegers steps, ToNumbers eta, ToNumbers rho, ToIntegers told
#define JAXCONTACT_TO                                                                                         \
  Results {                                                                                                   \
    z->typed_data(), certificate->element_count() ? certificate->typed_data() : nullptr, steps->typed_data(), \
        Found<Real>{eta->typed_data(), rho->typed_data(), told->typed_data(),                                 \
                    certificate->element_count() ? Tells::OUTCOME : Tells::STATUS},                           \
        contacts(q_)                                                                                          \
  }

ffi::Error Principal(ffi::ThreadPool pool, Numbers M_, Numbers q_, Booleans wanted_, int64_t budget_,
                     JAXCONTACT_RESULTS) {
  const Results to = JAXCONTACT_TO;
  const int64_t m = to.m;
  const int budget = int(budget_);
  const Real *M = M_.typed_data(), *q = q_.typed_data();
  const bool* wanted = wanted_.element_count() ? wanted_.typed_data() : nullptr;
  return solved(
      pool, M_, q_, to, m <= GROUPED && !wanted, 0,
      [=](auto& judge, int64_t b, Workspace<Real>& work) {
        Real* certificate = to.certificates_at(b, judge.given.count, work);
        return principal_lanes(judge, budget, work, to.z + b * m, certificate, to.steps + b);
      },
      [=](auto stride, int64_t b, Workspace<Real>& work, Real* certificate) {
        int outcome;
        principal<stride()>(M + b * m * m, q + b * m, wanted ? wanted + b * m : nullptr, budget, work, to.z + b * m,
                            certificate, &outcome, to.steps + b);
        return outcome;
      });
}

ffi::Error Lemke(ffi::ThreadPool pool, Numbers M_, Numbers q_, Numbers covering_, int64_t budget_, JAXCONTACT_RESULTS) {
  const Results to = JAXCONTACT_TO;
  const int64_t m = to.m;
  const int budget = int(budget_);
  const Real *M = M_.typed_data(), *q = q_.typed_data();
  const Real* covering = covering_.element_count() ? covering_.typed_data() : nullptr;
  return solved(
      pool, M_, q_, to, m <= GROUPED, 1,
      [=](auto& judge, int64_t b, Workspace<Real>& work) {
        Real* certificate = to.certificates_at(b, judge.given.count, work);
        return lemke_lanes(judge, covering ? covering + b * m : nullptr, budget, work, to.z + b * m, certificate,
                           to.steps + b);
      },
      [=](auto stride, int64_t b, Workspace<Real>& work, Real* certificate) {
        int outcome;
        lemke<stride()>(M + b * m * m, q + b * m, covering ? covering + b * m : nullptr, budget, work, to.z + b * m,
                        certificate, &outcome, to.steps + b);
        return outcome;
      });
}

ffi::Error Direct(ffi::ThreadPool pool, Numbers M_, Numbers q_, JAXCONTACT_RESULTS) {
  const Results to = JAXCONTACT_TO;
  const int64_t m = to.m;
  return solved(
      pool, M_, q_, to, true, 0,
      [=](auto& judge, int64_t b, Workspace<Real>& work) {
        constexpr int size = sizeof(judge.given.load) / sizeof(judge.given.load[0]);
        std::memset(to.steps + b, 0, sizeof(int) * judge.given.count);
        if constexpr (size <= DIRECT_LIMIT)
          return direct(judge, to.z + b * m, to.certificates_at(b, judge.given.count, work));
        else
          return Ended<Real>{};
      },
      [](auto&&...) { return 0; });
}

ffi::Error GaussSeidel(ffi::ThreadPool pool, Numbers M_, Numbers q_, Numbers start_, int64_t most, double relaxation,
                       double target, JAXCONTACT_RESULTS) {
  const Results to = JAXCONTACT_TO;
  const int64_t m = to.m;
  const Sweeps sweeps{int(most), relaxation, target};
  const Real *M = M_.typed_data(), *q = q_.typed_data();
  const Real* start = start_.element_count() ? start_.typed_data() : nullptr;
  return over_problems(
      pool, problems(q_), m, SWEEPS_PER_PIECE, m <= GROUPED, 0,
      [=](auto size, int64_t b, int count, Workspace<Real>& work) {
        const Given<size(), Real> given(M + b * m * m, q + b * m, count);
        gauss_seidel_lanes(given, start ? start + b * m : nullptr, sweeps, work, to.z + b * m,
                           to.certificates_at(b, count, work), to.steps + b, to.found.at(b));
      },
      [=](auto stride, int64_t b, Workspace<Real>& work) {
        gauss_seidel<stride()>(M + b * m * m, q + b * m, start ? start + b * m : nullptr, sweeps, work, to.z + b * m,
                               to.certificate_at(b, work), to.steps + b, to.found.at(b));
      });
}

ffi::Error Measure(ffi::ThreadPool pool, Numbers M_, Numbers q_, Numbers z_, Numbers certificate_, ToNumbers eta,
                   ToNumbers rho, ToIntegers flags) {
  const Results to{z_.typed_data(),
                   certificate_.typed_data(),
                   nullptr,
                   {eta->typed_data(), rho->typed_data(), flags->typed_data(), Tells::FLAGS},
                   contacts(q_)};
  const Real* z = z_.typed_data();
  return solved(
      pool, M_, q_, to, to.m <= GROUPED, 0,
      [=](auto& judge, int64_t b, Workspace<Real>&) {
        judge.measure(z + b * to.m);
        return Ended<Real>{{}, to.certificate + b * to.m};
      },
      [](auto&&...) { return int(SOLVED); });
}

ffi::Error Classify(ffi::ThreadPool pool, Numbers M_, Numbers q_, Numbers z_, ToNumbers w_, ToBooleans active_,
                    ToBooleans degenerate_) {
  const int64_t m = contacts(q_);
  const Real *M = M_.typed_data(), *q = q_.typed_data(), *z = z_.typed_data();
  const Classes<Real> to{w_->typed_data(), active_->typed_data(), degenerate_->typed_data()};
  const auto at = [=](int64_t b) { return Classes<Real>{to.w + b * m, to.active + b * m, to.degenerate + b * m}; };
  return over_problems(
      pool, problems(q_), m, 1, m <= GROUPED, 0,
      [=](auto size, int64_t b, int count, Workspace<Real>&) {
        classes_of_group(Given<size(), Real>(M + b * m * m, q + b * m, count), z + b * m, at(b));
      },
      [=](auto stride, int64_t b, Workspace<Real>& work) {
        classes<stride()>(M + b * m * m, q + b * m, z + b * m, work, at(b));
      });
}

ffi::Error Condition(ffi::ThreadPool pool, Numbers M_, Booleans held_, ToNumbers result_) {
  const int64_t m = contacts(held_);
  const Real* M = M_.typed_data();
  const bool* held = held_.typed_data();
  Real* result = result_->typed_data();
  return over_problems(
      pool, problems(held_), m, 1, m <= GROUPED, 0,
      [=](auto size, int64_t b, int count, Workspace<Real>& work) {
        condition_lanes<size()>(M + b * m * m, held + b * m, count, work, result + b);
      },
      [=](auto stride, int64_t b, Workspace<Real>& work) {
        result[b] = condition<stride()>(M + b * m * m, held + b * m, work);
      });
}

ffi::Error OfPairs(ffi::ThreadPool pool, Numbers P_, Numbers N_, Numbers q_, ToNumbers z, ToNumbers w,
                   ToNumbers condition, ToBooleans active, ToBooleans degenerate, ToNumbers eta, ToNumbers rho,
                   ToIntegers status) {
  const int64_t m = contacts(q_);
  const Real *P = P_.typed_data(), *N = N_.typed_data(), *q = q_.typed_data();
  const Found<Real> found{eta->typed_data(), rho->typed_data(), status->typed_data(), Tells::STATUS};
  const PairsFound<Real> to{z->typed_data(),      w->typed_data(),          condition->typed_data(),
                            active->typed_data(), degenerate->typed_data(), found};
  const auto at = [=](int64_t b) {
    return PairsFound<Real>{to.z + b * m,      to.w + b * m,          to.condition + b,
                            to.active + b * m, to.degenerate + b * m, found.at(b)};
  };
  return over_problems(
      pool, problems(q_), m, 1, true, 0,
      [=](auto size, int64_t b, int count, Workspace<Real>&) {
        if constexpr (size() <= PAIRS_LIMIT)
          Pairs<size(), Real>(P + b * m * m, N + b * m * m, q + b * m, count)
              .judge(P + b * m * m, N + b * m * m, q + b * m, count, at(b));
      },
      [](auto...) {});
}

}  // namespace jaxcontact

#define JAXCONTACT_JOIN_(a, b, c) a##b##_##c
#define JAXCONTACT_JOIN(a, b, c) JAXCONTACT_JOIN_(a, b, c)
#define JAXCONTACT_NAME(kernel) JAXCONTACT_JOIN(jaxcontact_, kernel, JAXCONTACT_REAL)
#define JAXCONTACT_BIND xla::ffi::Ffi::Bind().Ctx<xla::ffi::ThreadPool>()
#define JAXCONTACT_INTEGERS Ret<ffi::Buffer<ffi::S32>>()
#define JAXCONTACT_ANSWER Ret<Numbers>().Ret<Numbers>().JAXCONTACT_INTEGERS
#define JAXCONTACT_FOUND Ret<Numbers>().Ret<Numbers>().JAXCONTACT_INTEGERS
#define JAXCONTACT_CLASSES Ret<Booleans>().Ret<Booleans>()

namespace jaxcontact {

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(principal), Principal,
                              JAXCONTACT_BIND.Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Arg<Booleans>()
                                  .Attr<int64_t>("budget")
                                  .JAXCONTACT_ANSWER.JAXCONTACT_FOUND);

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(lemke), Lemke,
                              JAXCONTACT_BIND.Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Attr<int64_t>("budget")
                                  .JAXCONTACT_ANSWER.JAXCONTACT_FOUND);

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(direct), Direct,
                              JAXCONTACT_BIND.Arg<Numbers>().Arg<Numbers>().JAXCONTACT_ANSWER.JAXCONTACT_FOUND);

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(gauss_seidel), GaussSeidel,
                              JAXCONTACT_BIND.Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Attr<int64_t>("sweeps")
                                  .Attr<double>("relaxation")
                                  .Attr<double>("target")
                                  .JAXCONTACT_ANSWER.JAXCONTACT_FOUND);

XLA_FFI_DEFINE_HANDLER_SYMBOL(
    JAXCONTACT_NAME(measure), Measure,
    JAXCONTACT_BIND.Arg<Numbers>().Arg<Numbers>().Arg<Numbers>().Arg<Numbers>().JAXCONTACT_FOUND);

XLA_FFI_DEFINE_HANDLER_SYMBOL(
    JAXCONTACT_NAME(classify), Classify,
    JAXCONTACT_BIND.Arg<Numbers>().Arg<Numbers>().Arg<Numbers>().Ret<Numbers>().JAXCONTACT_CLASSES);

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(condition), Condition,
                              JAXCONTACT_BIND.Arg<Numbers>().Arg<Booleans>().Ret<Numbers>());

XLA_FFI_DEFINE_HANDLER_SYMBOL(JAXCONTACT_NAME(pairs), OfPairs,
                              JAXCONTACT_BIND.Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Arg<Numbers>()
                                  .Ret<Numbers>()
                                  .Ret<Numbers>()
                                  .Ret<Numbers>()
                                  .JAXCONTACT_CLASSES.JAXCONTACT_FOUND);

}  // namespace jaxcontact
