// Sessions of one plan on separate threads, and batches of worlds: numbers equal those on one thread.
// threads COUNT FILE.hqp ...; made for the thread sanitizer.
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>
#include <vector>

#include <batch.hpp>

namespace {

using Plan = std::shared_ptr<const hqp::Plan>;
using Numbers = std::vector<double>;
constexpr int kTicks = 5;
constexpr std::size_t kWorlds = 40;

// x of all ticks at home.
Numbers alone(const Plan& plan) {
  hqp::Session session(plan);
  const Numbers q = session.home(), v(std::size_t(session.nv()));
  Numbers found;
  for (int i = 0; i < kTicks; ++i) {
    const hqp::Tick& tick = session.step(q, v);
    found.insert(found.end(), tick.x().begin(), tick.x().end());
  }
  return found;
}

// x of the last tick in every world after equally many ticks; each begins near home.
Numbers together(const Plan& plan, std::size_t threads) {
  hqp::Batch batch(plan, kWorlds, threads);
  const Numbers& home = batch.session().current().robot().home;
  const hqp::Tick& tick = batch.session().tick();
  Numbers q, v(kWorlds * std::size_t(batch.session().current().line().nv())), commands(kWorlds * tick.command().size());
  Numbers residuals(kWorlds * batch.session().levels()), x(kWorlds * tick.x().size());
  std::vector<std::int32_t> status(kWorlds);
  for (std::size_t i = 0; i < kWorlds; ++i) {
    q.insert(q.end(), home.begin(), home.end());
    q.back() += 1e-3 * double(i);
  }
  for (int i = 0; i < kTicks; ++i)
    batch.step(q.data(), v.data(), {}, commands.data(), status.data(), residuals.data(), x.data());
  return x;
}

bool same(const char* path, std::size_t threads) {
  const Plan plan = hqp::read(path);
  std::vector<Numbers> found(threads);
  std::vector<std::thread> running;
  for (Numbers& each : found) running.emplace_back([&] { each = alone(plan); });
  for (std::thread& each : running) each.join();
  bool right = together(plan, threads) == together(plan, 1);
  for (const Numbers& each : found) right = right && each == alone(plan);
  std::printf("%s: %s on %zu threads\n", path, right ? "the same numbers" : "other numbers", threads);
  return right;
}

}  // namespace

int main(int argc, char** argv) {
  const int threads = argc > 2 ? std::atoi(argv[1]) : 0;
  if (threads < 1) return 2;
  bool right = true;
  for (int k = 2; k < argc; ++k) right = same(argv[k], std::size_t(threads)) && right;
  return right ? 0 : 1;
}
