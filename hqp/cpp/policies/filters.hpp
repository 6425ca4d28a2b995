// Many filters of one plan over the sessions of a batch.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../session/batch.hpp"
#include "filtered.hpp"

namespace hqp {

class Filters {
 public:
  Filters(const std::shared_ptr<const Plan>& plan, std::size_t count, std::size_t threads)
      : batch_(plan, count, threads) {
    for (std::size_t i = 0; i < count; ++i) filters_.push_back(filter_of(plan));
    for (std::size_t k = 0; k < batch_.threads(); ++k)
      filtered_.push_back(std::make_unique<Filtered>(plan, *filters_[0], batch_.session(k)));
  }

  // See Batch::step; policy (count, motors).
  void step(const double* q, const double* v, const double* policy, double* commands, const Batch::Written& written) {
    const Line& line = batch_.session().current().line();
    const std::size_t nq = std::size_t(line.nq()), nv = std::size_t(line.nv()), n = filters_[0]->motors();
    batch_.run(written, [&](std::size_t thread, Stacks& session, std::size_t i) -> const Tick& {
      return filtered_[thread]->step(*filters_[i], session, q + i * nq, v + i * nv, policy + i * n, {},
                                     commands + i * n);
    });
  }
  void reset(std::size_t i) { batch_.reset(i), filters_[i]->reset(); }
  Batch& batch() { return batch_; }

 private:
  Batch batch_;
  std::vector<std::unique_ptr<Filtered>> filtered_;  // by thread
  std::vector<std::unique_ptr<Filter>> filters_;     // by world
};

}  // namespace hqp
