// A velocity session from a plan's file follows a target with perfect servos, and prints where the joints end:
//   build/cpp/follow ur5.hqp tool0 0.05 0 0.1
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <vector>

#include <session.hpp>

int main(int argc, char** argv) try {
  if (argc != 6) return std::fprintf(stderr, "usage: follow PLAN.hqp ELEMENT X Y Z, the shift of its target [m]\n"), 2;
  hqp::Session session = hqp::load(argv[1]);
  hqp::Reference target = session.reference(argv[2]);
  std::vector<double> q = session.home(), v(std::size_t(session.nv()), 0.0);
  session.step(q, v);  // an element without a reference holds the value of the first state
  std::vector<double> goal = target.held();
  for (std::size_t i = 0; i < 3; ++i)  // a place (3), or the last column of a pose (4, 4)
    goal[goal.size() == 16 ? 4 * i + 3 : i] += std::atof(argv[3 + i]);
  for (int k = 0; k < 500; ++k) {
    target.at(goal);
    const hqp::Tick& tick = session.step(q, v);
    for (const hqp::Note& note : tick.notes()) std::fprintf(stderr, "tick %d: %s\n", k, note.text().c_str());
    if (!tick.solved()) return 1;
    std::copy(tick.x().begin(), tick.x().begin() + v.size(), v.begin());
    session.integrate(q.data(), v.data(), session.dt(), q.data());
  }
  for (double angle : q) std::printf("%.9f\n", angle);
} catch (const std::exception& error) {
  return std::fprintf(stderr, "%s\n", error.what()), 1;
}
