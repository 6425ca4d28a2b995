// Many walkers of one plan over the sessions of a batch.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../session/batch.hpp"
#include "steered.hpp"

namespace hqp {

class Walkers {
 public:
  Walkers(const std::shared_ptr<const Plan>& plan, std::size_t count, std::size_t threads)
      : plan_(plan), batch_(plan, count, threads), stopping_(count) {
    for (std::size_t k = 0; k < batch_.threads(); ++k)
      steered_.push_back(std::make_unique<Steered>(plan, batch_.session(k)));
    for (std::size_t i = 0; i < count; ++i) walkers_.push_back(walker_of(plan));
  }

  // See Batch::step; loads (count, 2), or null.
  void step(const double* q, const double* v, const double* loads, double* commands, const Batch::Written& written) {
    const Line& line = batch_.session().current().line();
    const std::size_t nq = std::size_t(line.nq()), nv = std::size_t(line.nv()), n = walkers_[0]->motors();
    batch_.run(written, [&](std::size_t thread, Stacks& session, std::size_t i) -> const Tick& {
      end(session, i);
      return steered_[thread]->step(*walkers_[i], session, q + i * nq, v + i * nv, loads ? loads + 2 * i : nullptr, {},
                                    commands + i * n);
    });
  }
  void go(std::size_t i, const Command& command) {
    order(i, [&](Walker& walker) { walker.go(command); });
  }
  void follow(std::size_t i, const std::vector<Foothold>& wanted) {
    order(i, [&](Walker& walker) { walker.follow(wanted); });
  }
  void stop(std::size_t i) { walkers_[i]->stop(); }
  // End the walk, then hold until resume().
  void halt(std::size_t i, const std::string& reason) {
    walkers_[i]->stop(), stopping_[i] = reason;
    if (!walkers_[i]->state().started) batch_.change(i, [&](Stacks& session) { end(session, i); });
  }
  void resume(std::size_t i) { stopping_[i].clear(), batch_.resume(i); }
  void reset(std::size_t i) {
    batch_.reset(i), stopping_[i].clear();
    walkers_[i] = walker_of(plan_);
  }
  const Walker& walker(std::size_t i) const { return *walkers_[i]; }
  Batch& batch() { return batch_; }

 private:
  // Give a world an order, unless it is stopped.
  template <class Order>
  void order(std::size_t i, const Order& order) {
    std::string why = stopping_[i];
    if (why.empty())
      batch_.change(i, [&](Stacks& session) {
        if (const char* reason = session.current().halt().why()) why = reason;
      });
    if (why.empty()) order(*walkers_[i]);
    else walkers_[i]->refuse(why);
  }
  void end(Stacks& session, std::size_t i) {  // a walk that is to end has ended
    if (stopping_[i].empty() || (walkers_[i]->state().started && !walkers_[i]->stands())) return;
    session.current().halt().stop(stopping_[i]);
    stopping_[i].clear();
  }

  std::shared_ptr<const Plan> plan_;
  Batch batch_;
  std::vector<std::unique_ptr<Steered>> steered_;  // by thread
  std::vector<std::unique_ptr<Walker>> walkers_;   // by world
  std::vector<std::string> stopping_;
};

}  // namespace hqp
