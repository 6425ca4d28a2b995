// G1 on both feet in MuJoCo's C library at 1 kHz: a plan from a file, no Python. Lines on stdin move hands, by metres
// from where they began: "right 0.05 0 0.1".  standing FOLDER SECONDS [--fast: not in real time]
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

#include <mujoco/mujoco.h>
#include <session.hpp>

#include "mujoco_map.hpp"

// Lines that have come so far, without waiting for more.
struct Input {
  std::string text;

  Input() { fcntl(STDIN_FILENO, F_SETFL, fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK); }
  bool line(char* name, double* at) {
    char more[256];
    for (ssize_t n; (n = read(STDIN_FILENO, more, sizeof more)) > 0;) text.append(more, std::size_t(n));
    const std::size_t end = text.find('\n');
    if (end == std::string::npos) return false;
    const bool read = std::sscanf(text.c_str(), "%31s %lf %lf %lf", name, at, at + 1, at + 2) == 4;
    text.erase(0, end + 1);
    return read;
  }
};

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string folder = argv[1];
  const bool fast = argc > 3;
  mjModel* model = mj_loadModel((folder + "/g1.mjb").c_str(), nullptr);
  if (!model) return 2;
  mjData* data = mj_makeData(model);
  hqp::Session session = hqp::load(folder + "/g1.hqp");  // all memory is taken here
  const Map map(model, session.joint_names());
  std::vector<double> q = session.home(), v(std::size_t(session.nv()), 0.0);
  map.put(data, q.data());
  mj_step1(model, data);

  const char* const names[] = {"left", "right"};
  std::vector<hqp::Reference> hands;
  for (const char* name : names) hands.push_back(session.reference(name));
  double off[2][3] = {}, goal[2][3] = {};
  Input input;
  using Clock = std::chrono::steady_clock;
  const long ticks = std::lround(std::atof(argv[2]) / session.dt());
  std::vector<double> times;
  times.reserve(std::size_t(ticks));
  long unsolved = 0, late = 0;
  Clock::time_point next = Clock::now();
  for (long i = 0; i < ticks; ++i) {
    char name[32];
    double at[3];
    while (input.line(name, at))
      for (int k = 0; k < 2; ++k)
        if (std::strcmp(name, names[k]) == 0) std::copy(at, at + 3, goal[k]);
    for (int k = 0; k < 2 && i > 0; ++k) {  // hold values exist after the first tick
      std::array<double, 3> place;
      for (int j = 0; j < 3; ++j) {
        off[k][j] += 0.002 * (goal[k][j] - off[k][j]);  // no jump
        place[std::size_t(j)] = hands[k].held()[std::size_t(j)] + off[k][j];
      }
      hands[k].at(place);
    }
    map.state(data, q.data(), v.data());
    const Clock::time_point begin = Clock::now();
    const hqp::Tick& tick = session.step(q, v, data->time, data->time);
    times.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count());
    if (!tick.solved()) {
      ++unsolved;
      for (const hqp::Note& note : tick.notes()) std::fprintf(stderr, "%s: %s\n", note.element, note.text().c_str());
    }
    map.drive(data, tick.command().data());
    mj_step2(model, data);
    mj_step1(model, data);
    next += std::chrono::microseconds(1000);
    if (fast) continue;
    if (Clock::now() > next) ++late, next = Clock::now();
    else std::this_thread::sleep_until(next);
  }
  double reached = 0.0;  // error of the hands at the targets of the lines
  for (int k = 0; k < 2; ++k) {
    const int body = mj_name2id(model, mjOBJ_XBODY, k ? "right_wrist_yaw_link" : "left_wrist_yaw_link");
    for (int j = 0; j < 3; ++j)
      reached = std::max(reached, std::fabs(hands[k].held()[std::size_t(j)] + goal[k][j] - data->xpos[3 * body + j]));
  }
  std::sort(times.begin(), times.end());
  const double fallen = session.home()[2] - data->qpos[2];
  std::printf("%ld ticks, %ld without an optimum, %ld late; step: median %.0f us, largest %.0f us\n", ticks, unsolved,
              late, times[times.size() / 2], times.back());
  std::printf("pelvis %.1f mm lower, hands within %.1f mm of their targets\n", 1e3 * fallen, 1e3 * reached);
  mj_deleteData(data), mj_deleteModel(model);
  return std::fabs(fallen) < 0.03 && reached < 0.01 && unsolved < ticks / 1000 + 5 ? 0 : 1;
}
