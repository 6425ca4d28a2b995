// Python interface of descents: the elements of a stack, one start after another.
#pragma once

#include <memory>
#include <tuple>
#include <vector>

#include "descent.hpp"
#include "live_assembly.hpp"

namespace binding {

using Members = std::vector<std::tuple<int, int, double, int>>;  // hqp::ErrorRows

class Descents {
 public:
  Descents(Assembly& assembly, LiveKinematics& robot, const Members& members, int groups, int nq, const hqp::Pace& pace)
      : assembly_(assembly),
        robot_(robot.get()),
        descent_(pace, converted(members), groups, nq, assembly.size()),
        still_(assembly.size()) {}
  Descents(const Descents&) = delete;

  // Take the references of all descents to follow; false for one that is out of the ordinary.
  bool aim(const nb::tuple& references) { return assembly_.take(references); }

  // From q, which is where the best found is afterwards, as are its merit and errors; returns the outcome and the
  // number of steps.
  std::tuple<int, int> run(const Written& q, const Written& merit, const Written& errors, double tolerance, int most,
                           double seconds) {
    const auto end = hqp::Clock::now() + std::chrono::duration_cast<hqp::Clock::duration>(
                                             std::chrono::duration<double>(std::min(seconds, 1e6)));
    const hqp::Demands& rows = assembly_.demands();
    const auto solve = [this](const double* at) -> const double* {
      robot_.update(at);
      return assembly_.write(at, still_.data()) ? assembly_.answer() : nullptr;
    };
    const hqp::End found =
        descent_.run(q.data(), tolerance, most, end, solve, robot_, rows.error(), rows.lower(), rows.upper());
    std::copy(descent_.q().begin(), descent_.q().end(), q.data());
    std::copy(descent_.merit().begin(), descent_.merit().end(), merit.data());
    std::copy(descent_.errors().begin(), descent_.errors().end(), errors.data());
    return {static_cast<int>(found), descent_.taken()};
  }

 private:
  static std::vector<hqp::ErrorRows> converted(const Members& members) {
    std::vector<hqp::ErrorRows> found;
    for (const auto& [start, stop, rate, group] : members) found.push_back({start, stop, rate, group});
    return found;
  }

  Assembly& assembly_;
  hqp::Kinematics& robot_;
  hqp::Descent descent_;
  Numbers still_;
};

}  // namespace binding
