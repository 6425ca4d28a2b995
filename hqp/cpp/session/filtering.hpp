// A filter behind a policy, from the file that PolicyFilterSession.export has written, without Python.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "session.hpp"

namespace hqp {

class Filtering;

class FilterSession {
 public:
  // Throws PlanError with a sentence.
  explicit FilterSession(const std::shared_ptr<const Plan>& plan);
  ~FilterSession();
  FilterSession(FilterSession&&) noexcept;
  FilterSession& operator=(FilterSession&&) noexcept;

  // One tick for q (nq), v (nv) and the policy's command, one number for each of joint_names(). No allocation, no
  // exception. command() is to be sent; the tick is that of the stack.
  const Tick& step(const double* q, const double* v, const double* policy) noexcept;
  // With the time of the state on the clock of now [s].
  const Tick& step(const double* q, const double* v, const double* policy, double time, double now) noexcept;
  const std::vector<double>& command() const;        // [rad], [rad/s] or [N m], as the policy's
  const std::vector<std::uint8_t>& limited() const;  // 1 for joints whose command differs from the policy's

  // Bring the robot to rest from the next step on and hold it there until resume(). Any thread may call both.
  void stop(const std::string& reason = "stop");
  void resume();
  // Forget commands, estimates and the warm start.
  void reset();

  int nq() const;
  int nv() const;
  double dt() const;
  const std::vector<std::string>& joint_names() const;

 private:
  std::unique_ptr<Filtering> filtering_;
};

}  // namespace hqp
