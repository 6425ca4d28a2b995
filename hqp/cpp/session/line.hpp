// A compiled stack at work: the robot's kinematics, its rows and its solver.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "../rows/planned.hpp"
#include "../torque/parts.hpp"
#include "foreign.hpp"
#include "outgoing.hpp"
#include "parts.hpp"
#include "tick.hpp"

namespace hqp {

// An element of the stack: place of its rows in the hierarchy (level, first, last in it) and among the motion rows.
struct Member {
  std::string name;
  bool hard, contact, equality, own_bounds;
  int level, first, last;
  int row, row_end;
  int slot;  // slot of its reference, -1 for none
  std::vector<std::string> row_names;
  // Bounds of rows that are not on motion: opened while the element is out; low, high: their declared values.
  double *lower = nullptr, *upper = nullptr;
  std::vector<double> low, high;
  bool out = false;
  int operation = -1;              // operation that writes its rows, -1 for none
  std::vector<std::string> units;  // units of joint limits, empty for other rows
};

class Line {
 public:
  // foreign: parts of a tick written in Python, null for none.
  template <class Node>
  Line(const Node& root, const Parts& parts, Foreign* foreign)
      : nq_(root.part("robot").integer("nq")),
        nv_(root.part("robot").integer("nv")),
        dt_(root.part("guards").number("dt")),
        n_(root.part("solver").integer("n")),
        parts_(parts),
        foreign_(foreign),
        levels_(levels_of(root.part("solver"), std::size_t(n_))),
        constraints_(root.part("solver").place("constraints", levels_.size() + 1)),
        law_(law_of(root.part("solver"), levels_.size(), std::size_t(n_))) {
    const Node motion = root.part("motion");
    if (!parts_.assembly) throw PlanError("the rows of the plan have no native code: compile hqp");
    if (nq_ < 1 || (parts_.kinematics && parts_.kinematics->size() != nq_) || assembly().size() != nv_)
      throw PlanError("the plan's joints give (nq, nv) = (" +
                      std::to_string(parts_.kinematics ? parts_.kinematics->size() : nq_) + ", " +
                      std::to_string(assembly().size()) + "), its robot has (" + std::to_string(nq_) + ", " +
                      std::to_string(nv_) + "): export it anew");
    largest_ = root.part("guards").number("largest");
    assembly().largest(largest_);
    int total = 0;
    for (const Level& level : levels_) starts_.push_back(total), total += level.m;
    slacks_.resize(std::size_t(total)), marks_.resize(std::size_t(total));
    fill(motion);
    ahead(nullptr);
    if (parts_.torque) {
      if (parts_.torque->coordinates() != std::size_t(nv_))
        throw PlanError("the contact elimination of the plan has " + std::to_string(parts_.torque->coordinates()) +
                        " coordinates, its robot " + std::to_string(nv_) + ": export it anew");
    }
    if (torque() ? order() != 2 || !motion.has("dynamics") : order() != 1 && order() != 2)
      throw PlanError("the order of the plan must be 1 or 2, at torque level 2 with dynamics: export it anew");
    for (const Node& one : root.parts("elements")) members_.push_back(member(one)), bind_free(motion, members_.back());
    for (const Member& one : members_)
      if (one.level >= 0) placed_.push_back(&one);
    std::stable_sort(placed_.begin(), placed_.end(), [this](const Member* one, const Member* other) {
      return start(*one) + one->first < start(*other) + other->first;
    });
    still_.resize(std::size_t(nv_));
    holding_.resize(std::size_t(n_)), momentum_.resize(holding_.size());
    origin_ = root.part("solver").maybe("origin", std::size_t(n_));
    bool nominal = false;
    for (const Node& one : motion.parts("loads")) nominal = nominal || one.part("plan").name() == "NominalTorque";
    if (torque() && origin_ && !nominal) weight_.resize(std::size_t(nv_));
  }
  Line(const Line&) = delete;

  int nq() const { return nq_; }
  int nv() const { return nv_; }
  int order() const { return parts_.assembly->order(); }
  double dt() const { return dt_; }
  int size() const { return n_; }                      // of x
  std::size_t rows() const { return slacks_.size(); }  // count in all levels
  const std::vector<Level>& levels() const { return levels_; }
  Kinematics* kinematics() const { return parts_.kinematics.get(); }  // null if Python has them
  Assembly& assembly() const { return *parts_.assembly; }
  LevelSolve* solver() const { return parts_.solver.get(); }  // null for a solver in Python
  TorqueParts* torque() const { return parts_.torque.get(); }
  std::vector<Slot>& slots() { return slots_; }
  const std::vector<Member>& members() const { return members_; }
  const std::vector<const Member*>& placed() const {
    return placed_;
  }  // members with rows, in the order of the hierarchy
  const std::vector<Slot>& slots() const { return slots_; }

  // Write rows and demands for a state, after its references; velocity: v of the state, or at velocity level the centre
  // of the limits' windows.
  void write(const double* q, const double* v, const double* velocity) {
    if (parts_.kinematics) parts_.kinematics->update(q);
    for (int i = 0; slowed_ && i < nv_; ++i) slowed_[i] = v[i] * slowing_[i];
    assembly().operate(q, velocity, v);
    if (foreign_ && foreign_->writes) foreign_->write();
    assembly().demand(velocity);
  }
  Solved solve(const double* v) {
    if (!torque()) return run(v);
    if (!weight_.empty()) {  // min |tau - tau_g| determines the remaining directions
      assembly().weight(weight_.data());
      if (!torque()->hold(weight_.data(), origin_)) return {kInvalid};
    }
    torque()->before(solve_, &assembly());  // another session may share it
    return torque()->run(v);
  }
  // Solve rows that are complete.
  Solved run(const double* v) { return solve_ ? solve_->run(v) : Solved{kAskPython}; }
  // Run this call ahead of the solver from now on; null for the solver alone.
  void ahead(SolveCall* call) { solve_ = call ? call : parts_.solver.get(); }
  // Write the rows again, without a solve.
  void rewrite(const double* v) {
    torque()->before(nullptr, &assembly());
    torque()->run(v);
  }

  Answered answer(const Solved& found) {
    Answered answer = answered(found);
    if (solver()) answer.allowed = solver()->exact().allowed();
    return answer;
  }

  void residuals(const double* slack, double* out) const {
    for (const Level& level : levels_) {
      double square = 0.0;
      for (int i = 0; i < level.m; ++i, ++slack) square += *slack * *slack;
      *out++ = std::sqrt(square);
    }
  }

  // Return true if the rows of an element are of ordinary size and its bounds in order; why: the reason if not.
  bool usable(const Member& member, Note& why) const {
    const auto wrong = [&](Cause cause, double amount, double allowed) {
      why.cause = cause, why.amount = amount, why.allowed = allowed;
      return false;
    };
    const std::ptrdiff_t row = member.row, end = std::max(row, std::min<std::ptrdiff_t>(member.row_end, laws_.m));
    const double J = largest(laws_.J + row * nv_, laws_.J + end * nv_);
    if (!(J <= largest_)) return wrong(Cause::kJacobian, J, largest_);
    const double demand = largest(laws_.demand + member.row, laws_.demand + member.row_end);
    if (!(demand <= largest_)) return wrong(Cause::kDemand, demand, largest_);
    for (int i = member.row; i < member.row_end; ++i) {
      const double low = laws_.lower[i], high = laws_.upper[i];
      why.row = i - member.row;
      if (!(low <= high && low < INFINITY && high > -INFINITY)) return wrong(Cause::kBounds, low, high);
    }
    return true;
  }
  // Free the rows of an element for this tick; keep the finite entries of a contact with an eliminated force, at rest.
  void leave_out(const Member& member) {
    const bool reaction = torque() && member.level < 0;
    for (int i = member.row; i < member.row_end; ++i) {
      for (int j = 0; i < laws_.m && j < nv_; ++j) {
        double& entry = const_cast<double*>(laws_.J)[std::ptrdiff_t(i) * nv_ + j];
        if (!(std::fabs(entry) <= largest_)) entry = 0.0;
      }
      laws_.demand[i] = 0.0;
      laws_.lower[i] = reaction ? 0.0 : -INFINITY;
      laws_.upper[i] = reaction ? 0.0 : INFINITY;
    }
  }

  // Compute the torques that hold the robot up, and its momentum at v; return false if there are none.
  bool at_rest(const double* q, const double* v) {
    std::fill(still_.begin(), still_.end(), 0.0);
    parts_.kinematics->update(q);
    assembly().operate(q, still_.data(), still_.data());
    assembly().weight(still_.data());
    return torque()->at_rest(still_.data(), v, holding_.data(), momentum_.data());
  }
  const double* holding() const { return holding_.data(); }
  const double* momentum() const { return momentum_.data(); }

  // Free the rows of these members from now on; restore those of all others.
  void go_without(const std::vector<bool>& out) {
    for (std::size_t k = 0; k < members_.size(); ++k) {
      Member& member = members_[k];
      if (member.out == out[k]) continue;
      member.out = out[k];
      assembly().out(member.name, member.row, member.row_end, member.out);
      for (std::size_t i = 0; i < member.low.size(); ++i) {
        member.lower[i] = member.out ? -INFINITY : member.low[i];
        member.upper[i] = member.out ? INFINITY : member.high[i];
      }
      if (torque() && member.level < 0) {
        const auto out = torque()->out().begin();
        std::fill(out + member.row, out + member.row_end, member.out);
      }
    }
  }

  // Make the outgoing command of its answers; see Outgoing.
  Outgoing outgoing(std::vector<int> motors, std::vector<double> changes, double violation,
                    std::vector<std::string> sentences) const {
    std::vector<Outgoing::Part> parts;
    for (const Member* one : placed_)
      if (one->level < constraints_)
        parts.push_back(
            {one->name, one->level, one->first, one->last, one->row_names, assembly().operation(one->operation)});
    return {n_,
            levels_,
            constraints_,
            law_,
            std::move(parts),
            std::move(motors),
            std::move(changes),
            violation,
            std::move(sentences)};
  }
  int start(const Member& member) const { return starts_[std::size_t(member.level)]; }
  const double* error(const Member& member) const { return laws_.error + member.row; }
  // Force of a contact on the robot (row_end - row) at the torque x and the latest rows, in the axes of its rows; the
  // reactions of all constraints are written to `force`.
  const double* force(const Member& contact, const double* x, std::vector<double>& force) const {
    torque()->forces(x, force);
    for (std::size_t i = 0; i < force.size(); ++i) force[i] *= -laws_.weight[i];
    return force.data() + contact.row;
  }

 private:
  static const Status* statuses() {
    static constexpr Status all[] = {Status::kOptimal,      Status::kRankUncertain,  Status::kConstraintsViolated,
                                     Status::kNotCertified, Status::kIterationLimit, Status::kTimeLimit};
    return all;
  }
  Answered answered(const Solved& found) {
    if (found.outcome == kAskPython) return foreign_->solve();
    if (found.outcome != kOptimal && foreign_ && foreign_->judges) return foreign_->judge(found);
    BoundKernel& exact = solver()->exact();
    if (found.outcome == kUnsettled) return unsettled();
    const double* values = found.values ? found.values : exact.numbers().data();
    const Status status = statuses()[found.outcome < 0 || found.outcome > 5 ? 3 : found.outcome];
    Answered answer{status, values, values + n_, found.active ? found.active : exact.marks()};
    answer.points = found.points, answer.point_count = found.point_count;
    answer.iterations = found.iterations, answer.factorisations = found.factorisations;
    return answer;
  }
  // Answer of stages that ended early, or with constraints violated.
  Answered unsettled() {
    PricedStages& stages = solver()->stages();
    const bool off = solver()->describe(solver()->end().data(), slacks_.data(), marks_.data());
    Status status = !stages.ended()     ? solver()->limited() ? Status::kTimeLimit : Status::kIterationLimit
                    : stages.doubtful() ? Status::kRankUncertain
                                        : Status::kOptimal;
    if (off && status <= Status::kRankUncertain) status = Status::kConstraintsViolated;
    Answered answer{status, solver()->end().data(), slacks_.data(), marks_.data()};
    answer.points = solver()->points().data(), answer.point_count = solver()->points().size();
    return answer;
  }

  // Bind the bounds that are opened while a member is absent.
  template <class Node>
  void bind_free(const Node& motion, Member& member) {
    if (member.row < member.row_end || member.level < 0 || member.first == member.last) return;
    const Level& level = levels_[std::size_t(member.level)];
    member.lower = const_cast<double*>(level.lower) + member.first;
    member.upper = const_cast<double*>(level.upper) + member.first;
    if (motion.has("torque") && motion.part("torque").has("forces"))
      for (const Node& one : motion.part("torque").part("forces").parts("rows")) {
        const std::size_t m = one.part("lower").size();
        const double* lower = one.doubles("lower", m);
        if (member.lower < lower || member.lower >= lower + m) continue;
        const std::ptrdiff_t at = member.lower - lower;
        if (at + (member.last - member.first) > std::ptrdiff_t(m))
          throw PlanError("rows on contact forces end outside their table: export the plan anew");
        member.lower = one.doubles("demand_lower", m) + at, member.upper = one.doubles("demand_upper", m) + at;
        break;
      }
    const std::ptrdiff_t count = member.last - member.first;
    member.low.assign(member.lower, member.lower + count), member.high.assign(member.upper, member.upper + count);
  }

  static double largest(const double* from, const double* to) {  // magnitude, NaN if a number is NaN
    double most = 0.0;
    for (; from < to && !std::isnan(most); ++from)
      if (!(std::fabs(*from) <= most)) most = std::fabs(*from);
    return most;
  }

  template <class Node>
  void fill(const Node& p) {
    for (const Node& one : p.parts("loads")) {
      slots_.push_back(load_slot(one));
      slot_names_.push_back(one.text("name"));
    }
    laws_ = laws(p.part("laws"), order(), nv_);
    for (const Node& one : p.parts("slots")) {
      slots_.push_back(slot(one, assembly().operations()));
      slot_names_.push_back(one.text("name"));
      if (!slots_.back().target && slots_.back().size() > 0)
        throw PlanError("element '" + one.text("name") + "': its reference has no array in the plan: export it anew");
    }
    if (p.has("slowing")) {
      slowing_ = p.part("slowing").doubles("scale", nv_);
      slowed_ = p.part("slowing").doubles("f", nv_);
    }
  }
  template <class Node>
  Member member(const Node& p) {
    const std::vector<int> place = p.ints("place"), rows = p.ints("rows");
    if (place.size() != 2 || rows.size() != 2)
      throw PlanError("element '" + p.text("name") + "': place and rows must be [first, last], given " +
                      std::to_string(place.size()) + " and " + std::to_string(rows.size()) +
                      " numbers: export the plan anew");
    Member found{p.text("name"),
                 p.flag("hard"),
                 p.flag("contact"),
                 p.flag("equality"),
                 p.flag("own_bounds"),
                 p.integer("level"),
                 place[0],
                 place[1],
                 rows[0],
                 rows[1],
                 -1,
                 p.texts("row_names"),
                 nullptr,
                 nullptr,
                 {},
                 {}};
    found.units = p.texts("units");
    const int levels = static_cast<int>(levels_.size());
    const int most = found.level >= 0 && found.level < levels ? levels_[std::size_t(found.level)].m : 0;
    const int motions =
        torque() && found.level < 0 ? std::min(static_cast<int>(torque()->out().size()), laws_.total) : laws_.total;
    if (found.level >= levels || place[0] < 0 || place[0] > place[1] || (found.level >= 0 && place[1] > most) ||
        rows[0] < 0 || rows[0] > rows[1] || rows[1] > motions ||
        (!found.units.empty() && (found.level < 0 || found.units.size() != std::size_t(place[1] - place[0]) ||
                                  found.units.size() != found.row_names.size())))
      throw PlanError("element '" + found.name + "': level " + std::to_string(found.level) + ", place [" +
                      std::to_string(place[0]) + ", " + std::to_string(place[1]) + "], rows [" +
                      std::to_string(rows[0]) + ", " + std::to_string(rows[1]) + "] or its units do not fit " +
                      std::to_string(levels) + " levels, " + std::to_string(most) + " rows of its level and " +
                      std::to_string(motions) + " rows in all: export the plan anew");
    for (std::size_t k = 0; k < slot_names_.size(); ++k)
      if (slot_names_[k] == found.name) found.slot = static_cast<int>(k);
    if (found.slot < 0) return found;
    Slot& slot = slots_[std::size_t(found.slot)];
    const std::size_t size = std::size_t(slot.size());
    found.operation = slot.operation;
    if (p.has("hold")) slot.hold = p.part("hold").numbers();
    if (!p.has("hold") || size == 0) slot.hold.assign(size, 0.0);
    if (slot.hold.size() != size)
      throw PlanError("element '" + found.name + "': its hold value has " + std::to_string(slot.hold.size()) +
                      " numbers, needed " + std::to_string(size) + ": export the plan anew");
    if (size == 0 && !slot.elsewhere) found.slot = -1;
    return found;
  }

  int nq_, nv_;
  double dt_;
  int n_;
  Parts parts_;
  Foreign* foreign_;
  SolveCall* solve_ = nullptr;
  std::vector<Level> levels_;
  int constraints_;
  hqp::Law law_;
  Laws laws_{};
  std::vector<Slot> slots_;
  std::vector<std::string> slot_names_;
  std::vector<Member> members_;
  std::vector<const Member*> placed_;
  std::vector<int> starts_;  // first row of each level
  std::vector<double> slacks_, still_, holding_, momentum_;
  std::vector<std::int8_t> marks_;
  double largest_ = 0.0;
  double *slowing_ = nullptr, *slowed_ = nullptr;
  double* origin_ = nullptr;    // the torque that holds the robot up, null if the solver has no origin
  std::vector<double> weight_;  // g, for it
};

}  // namespace hqp
