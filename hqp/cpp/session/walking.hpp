// A biped that walks, from the file that Walker.export has written: a state in, torques out, without Python.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "../walking/footsteps.hpp"
#include "session.hpp"

namespace hqp {

class Walk;

class WalkingSession {
 public:
  // Throws PlanError with a sentence.
  explicit WalkingSession(const std::shared_ptr<const Plan>& plan);
  ~WalkingSession();
  WalkingSession(WalkingSession&&) noexcept;
  WalkingSession& operator=(WalkingSession&&) noexcept;

  // Walk at a velocity in the axes of the heading [m/s, m/s, rad/s], or the nearest one that steps can follow; why():
  // the reason of each difference, of footholds, too.
  void go(double forward, double left = 0.0, double turn = 0.0);
  std::vector<std::string> why() const;
  std::array<double, 3> velocity() const;
  // Step on footholds in the world, left and right in turn, then stand on the last two: the nearest ones within reach
  // of each other.  z: height of the ground [m].  Throws ReferenceError for two of one foot in turn and for numbers
  // that are not finite.
  void follow(const std::vector<Foothold>& footholds);
  std::vector<Foothold> ahead() const;  // footholds that no foot has left for yet
  // Come to stand with the feet side by side, over as many steps as it takes.
  void stop();
  // Stop, then hold with status kStopped until resume().
  void halt(const std::string& reason = "stop");
  void resume();

  // One tick for q (nq), v (nv) and the normal forces on the left and the right foot [N], null for none: then a foot
  // has landed when its time is up.  No allocation, no exception.  The torques are command(): those of the tick, scaled
  // by the weight felt, continuous where a phase begins.
  const Tick& step(const double* q, const double* v, const double* loads) noexcept;
  // With the time of the state on the clock of now [s].
  const Tick& step(const double* q, const double* v, const double* loads, double time, double now) noexcept;
  const std::vector<double>& command() const;
  const char* phase() const;    // "stand", "shift" or "swing"
  const char* support() const;  // feet that stand: "both", "left" or "right"
  bool walking() const;         // from go() to stop(), from follow() to the last foothold
  double time() const;          // since the first tick [s]
  std::array<double, 2> capture_point() const;
  const std::vector<double>& start() const;  // standing configuration before the walk (nq)

  int nq() const;
  int nv() const;
  double dt() const;
  const std::vector<std::string>& joint_names() const;  // in the order of a command

 private:
  std::unique_ptr<Walk> walk_;
};

}  // namespace hqp
