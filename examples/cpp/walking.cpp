// G1 walks in MuJoCo's C library: a walker and its session from a file, no Python.  First it repeats the walk of
// walking.py, bit by bit.  walking FOLDER
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>
#include <session.hpp>
#include <walking.hpp>

#include "mujoco_map.hpp"

constexpr long kFollow = 250, kGo = 1000, kStop = 1750, kTicks = 3000;

// Command the walk of walking.py.
void ask(hqp::WalkingSession& walker, long tick) {
  if (tick == kFollow) walker.follow({{hqp::kLeft, 0.15, 0.12}, {hqp::kRight, 0.3, -0.12}, {hqp::kLeft, 0.45, 0.12}});
  if (tick == kGo) walker.go(0.3, 0.0, 0.1);
  if (tick == kStop) walker.stop();
}

// Ticks of Python whose torques have other bits.
long differing(const std::shared_ptr<const hqp::Plan>& plan, const std::string& path) {
  hqp::WalkingSession walker(plan);
  std::ifstream file(path, std::ios::binary);
  const std::size_t nq = std::size_t(walker.nq()), nv = std::size_t(walker.nv());
  std::vector<double> numbers(nq + nv + 2 + walker.joint_names().size());
  const auto bytes = static_cast<std::streamsize>(numbers.size() * sizeof(double));
  long found = 0, ticks = 0;
  std::int32_t size;
  while (file.read(reinterpret_cast<char*>(&size), sizeof size)) {
    if (size != std::int32_t(numbers.size()) || !file.read(reinterpret_cast<char*>(numbers.data()), bytes)) return -1;
    ask(walker, ticks++);
    const double *q = numbers.data(), *loads = q + nq + nv;
    walker.step(q, q + nq, loads);
    found += !std::equal(walker.command().begin(), walker.command().end(), loads + 2);
  }
  return ticks == kTicks ? found : -1;
}

// Normal force of the ground on a body [N].
double load(const mjModel* m, mjData* d, int body) {
  double sum = 0.0;
  for (int i = 0; i < d->ncon; ++i) {
    const mjContact& contact = d->contact[i];
    const int one = m->geom_bodyid[contact.geom[0]], other = m->geom_bodyid[contact.geom[1]];
    if (one != body && other != body) continue;
    double force[6];
    mj_contactForce(m, d, i, force);
    sum += force[0] * std::fabs(contact.frame[2]);
  }
  return sum;
}

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const std::string folder = argv[1];
  const auto plan = hqp::read(folder + "/walker.hqp");
  const long other = differing(plan, folder + "/walking.ticks");
  std::printf("%ld ticks of Python, %ld with other bits\n", kTicks, other);
  mjModel* model = mj_loadModel((folder + "/walking.mjb").c_str(), nullptr);
  if (!model) return 2;
  mjData* data = mj_makeData(model);
  hqp::WalkingSession walker(plan);  // all memory is taken here
  const Map map(model, walker.joint_names());
  const int feet[] = {mj_name2id(model, mjOBJ_BODY, "left_ankle_roll_link"),
                      mj_name2id(model, mjOBJ_BODY, "right_ankle_roll_link")};
  std::vector<double> q = walker.start(), v(std::size_t(walker.nv()), 0.0), times;
  map.put(data, q.data());
  mj_forward(model, data);
  const double height = data->qpos[2];
  long unsolved = 0, steps = 0;
  bool swings = false;
  for (long i = 0; i < kTicks; ++i) {
    ask(walker, i);
    map.state(data, q.data(), v.data());
    const double loads[] = {load(model, data, feet[0]), load(model, data, feet[1])};
    const auto begin = std::chrono::steady_clock::now();
    const hqp::Tick& tick = walker.step(q.data(), v.data(), loads);
    times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    unsolved += !tick.solved();
    steps += swings && walker.phase()[1] != 'w';
    swings = walker.phase()[1] == 'w';
    map.drive(data, walker.command().data());
    for (int k = 0; k < 2; ++k) mj_step(model, data);
  }
  std::sort(times.begin(), times.end());
  const double far = std::hypot(data->qpos[0], data->qpos[1]), fallen = height - data->qpos[2];
  std::printf(
      "%ld steps, %.2f m, pelvis %.0f mm lower, %ld ticks without an optimum; tick: median %.0f us, p99 %.0f us\n",
      steps, far, 1e3 * fallen, unsolved, times[times.size() / 2], times[times.size() * 99 / 100]);
  mj_deleteData(data), mj_deleteModel(model);
  return other == 0 && steps >= 5 && far > 0.5 && std::fabs(fallen) < 0.05 && std::string(walker.phase()) == "stand"
             ? 0
             : 1;
}
