// The rows of a stack: operations that are added once, when it is compiled, and run together each tick.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "../common/reactions.hpp"
#include "../dynamics/equation_of_motion.hpp"
#include "../dynamics/kinematics.hpp"
#include "laws.hpp"
#include "loads.hpp"
#include "operations.hpp"
#include "references.hpp"

namespace hqp {

class Assembly : public Limiting {
 public:
  using Parts = std::vector<std::pair<int, int>>;  // first and last of some rows

  Assembly(std::vector<Body> bodies, const double* twists, int nq, double dt, int order)
      : nq_(nq), dt_(dt), order_(order), tree_(std::move(bodies), twists) {}
  Assembly(const Assembly&) = delete;

  template <class Plan>
  void add(const Plan& plan, const Target& out) {
    if (out.drift) tree_.need_motions();
    operations_.push_back(Operations(tree_, nq_, dt_, order_).make(plan, out));
    if (std::isfinite(operations_.back()->approach())) limits_.push_back(operations_.back().get());
    held_.resize(std::max({held_.size(), std::size_t(16), std::size_t(size()), out.rows, out.given}));
  }
  void laws(Laws laws) {
    demands_ = std::make_unique<Demands>(std::move(laws));
    for (auto* part : {&speed_, &braking_}) part->resize(std::size_t(demands_->size()));
    for (auto* part : {&left_, &held_back_}) part->resize(std::size_t(size()));
  }

  // A (nv, nv), its upper triangle, and b + g (nv,) are written with every tick, loads included.
  void dynamics(std::vector<BodyInertia> inertias, std::vector<double> rotors, const Vec3& gravity, double* A,
                double* bias) {
    tree_.need_motions();
    equation_ = std::make_unique<EquationOfMotion>(tree_, std::move(inertias), std::move(rotors), gravity, A, bias);
  }
  // Masses of the bodies from now on over those given; loads stay.
  void weigh(double heavier) {
    if (equation_) equation_->weigh(heavier);
  }
  // A load whose value is live; payloads count for centres of mass, too.
  template <class Plan>
  void load(const Plan& plan, const double* value) {
    if (plan.name() == "NominalTorque") return;  // no force
    if (plan.name() == "JointLoad") {
      std::vector<int> columns = plan.places("columns", std::size_t(size()));
      std::vector<double> inertia = plan.numbers("inertia", columns.size());
      loads_.add({std::move(columns), std::move(inertia), value});
      return;
    }
    const bool wrench = plan.name() == "ExternalWrench";
    const Frame frame = plan.frame("frame", tree_);
    loads_.add({frame, value, wrench, wrench && plan.flag("local"), !wrench || plan.flag("resisted")});
    if (wrench) return;
    tree_.carry({frame.body, frame.position, frame.rotation, value});
    tree_.need_motions();
  }

  // Rows that are written between those of native operations and the laws: their place in J and, for inequalities, in
  // the bounds (first, last).
  void written(Parts rows, Parts bounds) { written_ = std::move(rows), bounded_ = std::move(bounds); }
  // Switch an element out or in from now on: its rows, from start to stop, are free, and nothing stands on it.
  void out(const std::string& name, int start, int stop, bool out) {
    demands_->free(start, stop, out);
    for (const auto& operation : operations_) operation->stand(name, !out);
  }
  // A demand beyond it is out of the ordinary.
  void largest(double number) { largest_ = number * number; }

  // v: velocity that limits stand around; measured: velocity of the state.
  void operate(const double* q, const double* v, const double* measured) {
    tree_.update(v);
    if (equation_) {
      equation_->run();
      loads_.apply(tree_, equation_->gravity(), equation_->inertia(), equation_->bias());
    }
    for (const auto& operation : operations_) {
      operation->measure(measured);
      operation->run(q, v);
    }
  }
  void demand(const double* v) { demands_->run(v); }
  // After demand(): the constraints' rows are the first of all.
  void limit(const double* v, Reactions& reactions) override {
    for (Operation* one : limits_) {
      if (!demands_->takes(reactions.rows(), one->approach(), speed_.data(), braking_.data())) continue;
      reactions.towards(speed_.data(), left_.data());
      reactions.towards(braking_.data(), held_back_.data());
      for (int i = 0; i < size(); ++i) left_[i] = v[i] - left_[i];
      if (squared(left_.data(), size()) + squared(held_back_.data(), size()) < INFINITY)  // else a contact is left out
        one->around(left_.data(), held_back_.data());
    }
  }
  // g (nv): generalised gravity force with loads, after the rows.
  void weight(double* g) {
    equation_->weight(g);
    loads_.weigh(tree_, equation_->gravity(), g);
  }
  // The next state is unrelated to those before it.
  void begin() {
    for (const auto& operation : operations_) operation->begin();
  }
  void keep(CarryOver& state) {
    for (const auto& operation : operations_) operation->keep(state);
  }
  const Operation* operation(int number) const { return number < 0 ? nullptr : operations_[number].get(); }
  int operations() const { return static_cast<int>(operations_.size()); }
  // Renew the hold values of these elements after the kinematics, or keep the declared ones if no operation has them.
  void take_holds(const double* q, const double* v, std::vector<Slot*>& renewed) {
    if (!renewed.empty()) tree_.update(v);
    for (Slot* slot : renewed) {
      const std::size_t size = slot->target ? slot->hold.size() : 0;
      if (size > 0 && slot->operation >= 0) {
        if (held_.size() < size) held_.resize(size);
        std::fill(slot->target, slot->target + size, 0.0);
        std::fill(held_.begin(), held_.end(), 0.0);
        operations_[slot->operation]->begin();
        if (operations_[slot->operation]->hold(q, v, held_.data()))
          std::copy_n(held_.begin(), size, slot->hold.begin());
      }
      slot->settle();
    }
    renewed.clear();
  }
  // Distance beyond their limits at which the rows of an operation, -1 for none, come to rest: see Operation::overrun.
  void overrun(int operation, const double* q, const double* v, std::vector<double>& over) {
    over.clear();
    if (operation >= 0) operations_[operation]->overrun(q, v, over);
  }
  bool small() const { return squared(demands_->demand(), demands_->size()) < largest_; }
  bool usable() const {
    if (!small()) return false;
    for (const auto& [first, last] : written_)
      if (!(demands_->squared(first, last) < largest_)) return false;
    for (const auto& [first, last] : bounded_)
      if (!demands_->apart(first, last)) return false;
    return true;
  }

  Demands& demands() { return *demands_; }
  const Demands& demands() const { return *demands_; }
  int size() const { return tree_.size(); }
  double dt() const { return dt_; }
  int order() const { return order_; }

 private:
  int nq_;
  double dt_;
  int order_;
  Tree tree_;
  std::unique_ptr<EquationOfMotion> equation_;
  std::vector<std::unique_ptr<Operation>> operations_;
  std::vector<Operation*> limits_;  // operations with bounds around a speed
  std::unique_ptr<Demands> demands_;
  Parts written_, bounded_;
  std::vector<double> held_;
  std::vector<double> speed_, braking_, left_, held_back_;  // one entry per row of constraints, per coordinate
  KnownLoads loads_;
  double largest_ = 0.0;
};

}  // namespace hqp
