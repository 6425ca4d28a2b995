// Lost contacts: assumed by every tick, but with too small a measured load.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "tick.hpp"

namespace hqp {

// Counts the ticks for which each contact has carried less than kLeastLoad. One without a measured load is not judged,
// and one whose load is missing for a tick keeps its count.
class ContactWatch {
 public:
  static constexpr double kLeastLoad = 1.0;  // a contact that carries less is not there [N]
  // For how long it has to carry less before it counts as lost [s]: a wheel on rollers bounces for a few ticks.
  static constexpr double kPatience = 0.02;

  ContactWatch(std::vector<std::string> names, double dt)
      : names_(std::move(names)),
        dt_(dt),
        patience_(std::max(1.0, std::rint(kPatience / dt))),
        ticks_(names_.size(), 0),
        out_(names_.size(), false) {}

  void measure(std::size_t k, double load) {  // [N]
    if (out_[k]) return;
    if (load < kLeastLoad) ++ticks_[k];
    else if (load >= kLeastLoad) ticks_[k] = 0;  // a NaN is neither
  }
  // Contacts that are out of a tick are not judged: nothing assumes them.
  void judge(std::size_t k, bool out) {
    out_[k] = out;
    if (out) ticks_[k] = 0;
  }
  template <class Report>
  void lost(const Report& report) const {
    for (std::size_t k = 0; k < ticks_.size(); ++k)
      if (double(ticks_[k]) >= patience_)
        report(Note{names_[k].c_str(), Status::kContactLost, Cause::kContact, "", 1e3 * double(ticks_[k]) * dt_,
                    kLeastLoad});
  }
  void keep(CarryOver& state) { state.take(ticks_.data(), ticks_.size()); }

 private:
  std::vector<std::string> names_;
  double dt_, patience_;
  std::vector<std::int64_t> ticks_;
  std::vector<bool> out_;
};

}  // namespace hqp
