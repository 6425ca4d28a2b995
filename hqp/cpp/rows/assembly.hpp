// The rows of a stack: operations that are added once, when it is compiled, and run together each tick.
#pragma once

#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include <nanobind/stl/optional.h>

#include "../common/solve_call.hpp"
#include "../dynamics/equation_of_motion.hpp"
#include "balance.hpp"
#include "collision.hpp"
#include "com.hpp"
#include "frames.hpp"
#include "holding_torque.hpp"
#include "kinetic_energy.hpp"
#include "laws.hpp"
#include "live_kinematics.hpp"
#include "loads.hpp"
#include "loop.hpp"
#include "manipulability.hpp"
#include "momentum.hpp"
#include "plan.hpp"
#include "wheels.hpp"

namespace binding {

class Assembly {
 public:
  using Parts = std::vector<std::tuple<int, int>>;  // first and last of some rows

  Assembly(const Columns& twists, const Bodies& bodies, double dt, int order, const nb::object& reference)
      : dt_(dt), order_(order), tree_(tree(twists, bodies)), loop_(reference) {}
  Assembly(const Assembly&) = delete;

  void add(const nb::object& object, const std::optional<Block>& J, const Written& error,
           const std::optional<Written>& drift, const Written& lower, const Written& upper, const Vector& reference,
           const std::optional<Vector>& normal, double weight, const Vector& rate, const Vector& feedforward) {
    kept_.push_back(object);
    const Plan plan(object, kept_);
    const hqp::Target out{J ? keep(*J) : nullptr,
                          keep(error),
                          drift ? keep(*drift) : nullptr,
                          keep(lower),
                          keep(upper),
                          keep(reference),
                          normal ? keep(*normal) : nullptr,
                          weight,
                          J ? static_cast<int>(J->shape(1)) : 0,
                          keep(rate),
                          keep(feedforward)};
    if (drift) tree_.need_motions();
    operations_.push_back(make(plan, out));
  }

  void laws(const Block& J, const Vector& error, const Vector& rate, const Vector& feedforward, const Vector& drift,
            const Vector& kp, const Vector& kd, const Vector& weight, const Picks& pick, const Kinds& kind,
            const Written& demand, const Written& lower, const Written& upper,
            const std::vector<std::tuple<int, int, double, double, double>>& saturations) {
    hqp::Laws laws{order_,
                   static_cast<int>(J.shape(0)),
                   static_cast<int>(J.shape(1)),
                   static_cast<int>(error.shape(0)),
                   keep(J),
                   keep(error),
                   keep(rate),
                   keep(feedforward),
                   keep(drift),
                   keep(kp),
                   keep(kd),
                   keep(weight),
                   keep(pick),
                   keep(kind),
                   keep(demand),
                   keep(lower),
                   keep(upper),
                   {}};
    for (const auto& [start, stop, fastest, hardest, damping] : saturations)
      laws.saturations.push_back({start, stop, fastest, hardest, damping});
    demands_ = std::make_unique<hqp::Demands>(std::move(laws));
  }

  // Placements and twists are written by this, ahead of the rows of a tick.
  void move(const nb::object& robot) {
    kept_.push_back(robot);
    kinematics_ = &nb::cast<LiveKinematics&>(robot).get();
  }
  void run(const Vector& q, const Vector& v) { operate(q.data(), v.data()); }
  void demand(const Vector& v) { demands_->run(v.data()); }

  // A (nv, nv), its upper triangle, and b + g (nv,) are written with every tick, loads included.
  void dynamics(const std::vector<hqp::BodyInertia>& inertias, Numbers rotors, const Vector& gravity,
                const WrittenColumns& A, const Written& bias) {
    const std::size_t n = tree_.size();
    if (A.shape(0) != n || A.shape(1) != n || bias.shape(0) != n || gravity.shape(0) != 3)
      throw nb::value_error("A, bias or gravity: wrong shape");
    tree_.need_motions();
    equation_ = std::make_unique<hqp::EquationOfMotion>(tree_, inertias, std::move(rotors), hqp::load(gravity.data()),
                                                        keep(A), keep(bias));
  }

  // A load whose value is live; payloads count for centres of mass, too.
  void load(const nb::object& object, const Vector& value) {
    kept_.push_back(object);
    const Plan plan(object, kept_);
    const bool wrench = plan.name() == "ExternalWrench";
    const hqp::Frame frame = plan.frame_of("frame");
    const double* numbers = keep(value);
    loads_.add({frame, numbers, wrench, wrench && plan.flag("local")});
    if (wrench) return;
    tree_.carry({frame.body, frame.position, frame.rotation, numbers});
    tree_.need_motions();
  }

  // Where the reference of an element goes, and its hold value, None for one that is not there.
  void slot(const std::string& name, const std::optional<Written>& target, Ints shape,
            const std::optional<Written>& normal, const Written& rate, const Written& feedforward, int plain) {
    loop_.add(name, {target ? keep(*target) : nullptr,
                     std::move(shape),
                     normal ? keep(*normal) : nullptr,
                     keep(rate),
                     keep(feedforward),
                     static_cast<int>(rate.shape(0)),
                     !target,
                     static_cast<hqp::Plain>(plain),
                     {}});
  }
  void hold(const std::string& name, const std::optional<Vector>& value) {
    hqp::Slot* slot = loop_.find(name);
    if (!slot) throw nb::key_error(name.c_str());
    slot->hold.clear();
    if (!value || !slot->target || slot->shape.empty()) return;
    std::size_t size = 1;
    for (const int n : slot->shape) size *= static_cast<std::size_t>(n);
    if (value->size() != size) throw nb::value_error(("the hold value of " + name + " does not fit its plan").c_str());
    slot->hold.assign(value->data(), value->data() + size);
  }
  // solve: of a workspace bound to the arrays of the laws, (outcome, ...) with 0 for an optimum; call: the same without
  // Python, where there is one. values: x and slack, active: marks, both its own. command: what of x is one. largest: a
  // demand beyond it is out of the ordinary.
  void answers(const nb::object& solve, const std::optional<nb::capsule>& call, const Vector& values,
               const Marks& active, Ints command, double largest) {
    solve_ = solve;
    call_ = call ? hqp::call_of(*call) : nullptr;
    values_ = keep(values), active_ = keep(active);
    value_count_ = values.size(), active_count_ = active.size();
    sent_.assign(values.data(), values.data() + std::min(values.size(), static_cast<std::size_t>(tree_.size())));
    marks_.assign(active_count_, 0);
    command_ = std::move(command);
    largest_ = largest * largest;
  }

  // Rows that are written between those of native operations and the laws: where they stand in J and, of inequalities,
  // in the bounds (first, last).
  void written(Parts rows, Parts bounds) { written_ = std::move(rows), bounded_ = std::move(bounds); }

  // References, rows, laws and solver: a record [command, x, slack, begin, seconds for rows and solve, solve's counts,
  // marks, points of stages where there were any, q and v of a tick of arrays and, at velocity level, where q comes to,
  // 1 where marks are others than in the record before + 2 for stages]; what solve returned where that is no optimum;
  // None where a reference, a row or a demand is out of the ordinary. v None for the x of the record before, at
  // velocity level; write: Python's rows, whether all are there.
  nb::object step(nb::handle q, nb::handle v, const nb::tuple& references, bool fresh, nb::handle write) {
    const hqp::Doubles at(q, true), speed(v.is_none() ? q : v, true);
    if (!at.data() || !speed.data()) throw nb::type_error("q and v are vectors of doubles");
    const double* velocity = v.is_none() ? sent_.data() : speed.data();
    begin_ = hqp::Clock::now();
    if (fresh) std::fill(marks_.begin(), marks_.end(), kNoMark);
    if (!loop_.take(references, fresh)) return nb::none();
    if (kinematics_) kinematics_->update(at.data());
    operate(at.data(), velocity);
    if (!write.is_none() && !nb::cast<bool>(write())) return nb::none();
    demands_->run(velocity);
    return usable() ? answered(velocity) : nb::none();
  }

  // A step of arrays alone, q (nq,) and v (nv,), or null for rest, where all is native: see hqp::Loop::aim. None as
  // well where the squares of a state sum up to `largest` or more, or its quaternions are off length one by `rounding`.
  // before: at velocity level the x around which limits stand, null for that of the record before.
  nb::object tick(nb::handle q, nb::handle v, const nb::dict& targets, bool fresh, nb::handle before, double largest,
                  double rounding) {
    const hqp::Doubles at(q, true), speed(v.is_none() ? q : v, true), sent(before.is_none() ? q : before, true);
    const int nq = kinematics_ ? kinematics_->size() : 0, nv = tree_.size();
    if (!kinematics_ || !at.data() || !speed.data() || !sent.data()) return nb::none();
    if (!at.has(&nq, 1) || (!v.is_none() && !speed.has(&nv, 1)) || (v.is_none() && order_ == 2)) return nb::none();
    const double square = hqp::squared(at.data(), nq) + (v.is_none() ? 0.0 : hqp::squared(speed.data(), nv));
    if (!(square < largest) || !kinematics_->unit(at.data(), rounding)) return nb::none();
    begin_ = hqp::Clock::now();
    if (!loop_.aim(targets, fresh)) return nb::none();
    kinematics_->update(at.data());
    const double* velocity = order_ == 2 ? speed.data() : before.is_none() ? sent_.data() : sent.data();
    if (v.is_none()) state_.assign(state_.size(), 0.0);
    operate(at.data(), velocity);
    demands_->run(velocity);
    return usable() ? answered(velocity, at.data(), v.is_none() ? nullptr : speed.data()) : nb::none();
  }

  // The same without Python's objects, for many configurations at rest under the same references: x, null for what is
  // out of the ordinary or was not solved; rows alone.
  bool take(const nb::tuple& references) { return loop_.take(references, true); }
  bool write(const double* q, const double* v) {
    operate(q, v);
    demands_->run(v);
    return hqp::squared(demands_->demand(), demands_->size()) < largest_;
  }
  const double* answer() {
    const hqp::Solved found = solved(nullptr);
    return found.outcome > hqp::kViolated ? nullptr : found.values ? found.values : values_;
  }
  const hqp::Demands& demands() const { return *demands_; }
  int size() const { return tree_.size(); }

 private:
  using Operation = std::unique_ptr<hqp::Operation>;
  static constexpr std::int8_t kNoMark = -128;

  bool usable() const {
    if (!(hqp::squared(demands_->demand(), demands_->size()) < largest_)) return false;
    for (const auto& [first, last] : written_)
      if (!(demands_->squared(first, last) < largest_)) return false;
    for (const auto& [first, last] : bounded_)
      if (!demands_->apart(first, last)) return false;
    return true;
  }
  nb::object answered(const double* v, const double* q = nullptr, const double* rate = nullptr) {
    const auto begun = hqp::Clock::now();
    const hqp::Solved found = solved(v);
    if (found.outcome == hqp::kInvalid) return nb::none();
    if (found.outcome != hqp::kOptimal)
      return nb::make_tuple(found.outcome, found.iterations, found.factorisations, found.judged);
    return record(found, hqp::seconds(begin_, begun) + found.before,
                  hqp::seconds(begun, hqp::Clock::now()) - found.before, q, rate);
  }
  void operate(const double* q, const double* v) {
    tree_.update(v);
    if (equation_) {
      equation_->run();
      loads_.apply(tree_, equation_->gravity(), equation_->inertia(), equation_->bias());
    }
    for (const auto& operation : operations_) operation->run(q, v);
  }

  hqp::Solved solved(const double* v) {
    hqp::Solved found{hqp::kAskPython};
    if (call_) {
      const nb::gil_scoped_release release;
      found = call_->run(v);
    }
    if (found.outcome != hqp::kAskPython) return found;
    const nb::tuple told = nb::cast<nb::tuple>(solve_());
    return {nb::cast<int>(told[0]), nb::cast<int>(told[1]), nb::cast<int>(told[2]), nb::cast<int>(told[3]),
            found.before};
  }

  nb::object record(const hqp::Solved& found, double filling, double solving, const double* q, const double* rate) {
    const std::size_t numbers = command_.size() + value_count_ + 5, points = sizeof(double) * found.point_count;
    const std::size_t nq = q ? kinematics_->size() : 0, nv = q ? tree_.size() : 0, moved = order_ == 1 ? nq : 0;
    const double* values = found.values ? found.values : values_;
    const std::int8_t* active = found.active ? found.active : active_;
    const nb::object made = nb::steal(PyByteArray_FromStringAndSize(
        nullptr, static_cast<Py_ssize_t>(sizeof(double) * (numbers + nq + nv + moved) + active_count_ + points + 1)));
    if (!made.is_valid()) nb::raise_python_error();
    double* out = reinterpret_cast<double*>(PyByteArray_AsString(made.ptr()));
    for (const int i : command_) *out++ = values[i];
    out = std::copy(values, values + value_count_, out);
    std::copy(values, values + sent_.size(), sent_.begin());
    for (const double number :
         {hqp::seconds({}, begin_), filling, solving, double(found.iterations), double(found.factorisations)})
      *out++ = number;
    std::int8_t* marks = reinterpret_cast<std::int8_t*>(out);
    std::copy(active, active + active_count_, marks);
    if (points) std::memcpy(marks + active_count_, found.points, points);
    std::int8_t* end = marks + active_count_ + points;
    if (q) {
      state_.resize(nq + nv + moved);
      std::copy(q, q + nq, state_.begin());
      if (rate) std::copy(rate, rate + nv, state_.begin() + nq);
      if (moved) kinematics_->integrate(q, values, dt_, state_.data() + nq + nv);
      std::memcpy(end, state_.data(), sizeof(double) * state_.size());
      end += sizeof(double) * state_.size();
    }
    *end = (points ? 2 : 0) + !std::equal(active, active + active_count_, marks_.begin());
    std::copy(active, active + active_count_, marks_.begin());
    return made;
  }

  Operation make(const Plan& p, const hqp::Target& out) {
    const std::string name = p.name();
    const auto rows = [&] { return hqp::Rows(out, tree_, p.frame_of("frame"), p.relative()); };
    const auto fixed = [&] { return hqp::Rows(out, tree_, p.frame_of("frame"), {}); };
    if (name == "Point") return std::make_unique<hqp::Point>(rows(), p.ints("axes"), p.vec3("offset"));
    if (name == "Pose") return std::make_unique<hqp::Pose>(rows());
    if (name == "Rotation") return std::make_unique<hqp::Rotation>(rows());
    if (name == "Angles") return std::make_unique<hqp::Angles>(rows(), p.ints("picked"), p.number("gimbal"));
    if (name == "Edge") return std::make_unique<hqp::Edge>(fixed(), p.vec3("axis"), p.vec3("first"), p.vec3("other"));
    if (name == "Wheel") {
      if (!out.normal) throw nb::value_error("a wheel needs the ground's normal");
      return std::make_unique<hqp::Wheel>(fixed(), p.number("radius"), p.vec3("axle"), p.ints("picked"),
                                          p.number("aligned"));
    }
    if (name == "Com") {
      tree_.need_centres();
      return std::make_unique<hqp::Com>(hqp::Rows(out, tree_, {}, p.relative()), static_cast<int>(p.number("part")),
                                        p.ints("axes"));
    }
    if (name == "Momentum") {
      tree_.need_centres();
      return std::make_unique<hqp::Momentum>(out, tree_, p.ints("picked"), p.list<hqp::BodyInertia>("inertias"));
    }
    if (name == "KineticEnergy")
      return std::make_unique<hqp::KineticEnergy>(out, tree_, p.list<hqp::BodyInertia>("inertias"),
                                                  p.numbers("rotors"));
    if (name == "Joints") return std::make_unique<hqp::Posture>(out, p.joints());
    if (name == "Coupling")
      return std::make_unique<hqp::Coupling>(out, p.part("joints").joints(), p.numbers("coefficients"));
    if (name == "JointBox") {
      hqp::Limits limits{p.numbers("low"),
                         p.numbers("high"),
                         p.numbers("speed"),
                         p.numbers("acceleration"),
                         p.numbers("braking"),
                         p.number("approach"),
                         p.number("return_velocity"),
                         dt_,
                         order_};
      return std::make_unique<hqp::JointBox>(out, p.part("joints").joints(), std::move(limits));
    }
    if (name == "Still") return std::make_unique<hqp::Still>(out, p.ints("columns"));
    if (name == "Steady") return std::make_unique<hqp::Steady>(out, p.ints("columns"), order_);
    if (name == "Frozen")
      return std::make_unique<hqp::Frozen>(out, p.part("joints").joints(), p.number("rate"), p.number("acceleration"),
                                           dt_, order_);
    if (name == "Pointing") return std::make_unique<hqp::Pointing>(fixed(), p.axis(), p.flag("point"));
    if (name == "Apart") return std::make_unique<hqp::Apart>(rows());
    if (name == "Manipulability")
      return std::make_unique<hqp::Manipulability>(fixed(), p.ints("picked"), p.ints("joints"));
    if (name == "HoldingTorque") {
      tree_.need_centres();
      return std::make_unique<hqp::HoldingTorque>(out, tree_, p.ints("columns"), p.numbers("limits"),
                                                  p.vec3("gravity"));
    }
    if (name == "Cone")
      return std::make_unique<hqp::Cone>(fixed(), p.axis(), p.flag("point"), p.number("angle"), p.barrier(dt_), order_);
    if (name == "Within") return within(p, out);
    if (name == "SupportPolygon") return support_polygon(p, out);
    if (name == "Balance") return balance(p, out);
    if (name == "Collision") return std::make_unique<hqp::Collision>(out, tree_, scene(p));
    throw nb::type_error(("no native operation for a plan of class " + name).c_str());
  }

  Operation within(const Plan& p, const hqp::Target& out) {
    Numbers low = p.numbers("lower");
    const int m = static_cast<int>(low.size()), nv = tree_.size();
    auto own = std::make_unique<hqp::Numbers>(m, out.J ? 0 : nv);
    const bool rates = p.flag("rates");
    const hqp::Target inner = own->target(out.J, rates ? nullptr : out.reference, out.weight, nv, order_ == 2);
    Operation task = make(p.part("task"), inner);
    return std::make_unique<hqp::Within>(out, std::move(own), std::move(task), std::move(low), p.numbers("upper"),
                                         p.barrier(dt_), rates, static_cast<int>(p.number("turn")), nv, order_);
  }

  Operation support_polygon(const Plan& p, const hqp::Target& out) {
    const int nv = tree_.size();
    auto own = std::make_unique<hqp::Numbers>(2, nv);
    tree_.need_centres();
    const hqp::Target inner = own->target(nullptr, nullptr, 1.0, nv, order_ == 2);
    auto com = std::make_unique<hqp::Com>(hqp::Rows(inner, tree_, {}, {}), 0, Ints{0, 1});
    std::vector<hqp::Corner> corners;
    for (const auto& [frame, point] : p.list<std::tuple<nb::object, Numbers>>("points"))
      corners.push_back({false, p.part_of(frame).frame(), vector(point)});
    for (const Numbers& corner : p.list<Numbers>("polygon")) corners.push_back({true, {}, {corner[0], corner[1], 0.0}});
    return std::make_unique<hqp::SupportPolygon>(out, std::move(own), std::move(com), std::move(corners),
                                                 p.number("margin"), p.barrier(dt_), order_);
  }

  Operation balance(const Plan& p, const hqp::Target& out) {
    const int nv = tree_.size();
    auto own = std::make_unique<hqp::Numbers>(2, 0);
    tree_.need_centres();
    const hqp::Target inner = own->target(out.J, nullptr, out.weight, nv, order_ == 2);
    auto com = std::make_unique<hqp::Com>(hqp::Rows(inner, tree_, {}, {}), 0, Ints{0, 1});
    std::vector<hqp::Corner> corners;
    for (const auto& [frame, point] : p.list<std::tuple<nb::object, Numbers>>("points"))
      corners.push_back({false, p.part_of(frame).frame(), vector(point)});
    return std::make_unique<hqp::Balance>(out, std::move(own), std::move(com), std::move(corners), p.number("k"),
                                          p.number("height"), p.number("gravity"), tree_);
  }

  hqp::CollisionScene scene(const Plan& p) {
    hqp::CollisionScene found;
    for (const auto& [body, ends, radius] : p.list<std::tuple<int, Numbers, double>>("links"))
      found.links.push_back({body, {hqp::load(ends.data()), hqp::load(ends.data() + 3)}, radius});
    for (const auto& [kind, size] : p.list<std::tuple<int, Numbers>>("world"))
      found.world.push_back({static_cast<hqp::Solid>(kind), vector(size)});
    found.chains = p.list<Ints>("chains");
    for (const auto& [one, two] : p.list<std::tuple<int, int>>("pairs")) found.pairs.push_back({one, two});
    found.clearances = p.numbers("clearances");
    const Slots slots = p.array<Slots>("slots");
    found.slots = slots.data();
    found.rows = static_cast<int>(slots.shape(0));
    found.influence = p.number("influence");
    found.rate = p.number("rate");
    found.recovery = p.number("recovery");
    found.outset = p.number("outset");
    found.step = p.number("step");
    found.dt = dt_;
    found.order = order_;
    if (order_ == 2) tree_.need_motions();
    return found;
  }

  template <typename Array>
  auto keep(const Array& array) -> decltype(array.data()) {
    kept_.push_back(nb::cast(array));
    return array.data();
  }
  hqp::Tree tree(const Columns& twists, const Bodies& bodies) {
    std::vector<hqp::Body> found;
    for (const auto& [parent, first, count, mass, centre, placement] : bodies) {
      const auto& [position, rotation] = placement;
      found.push_back({parent, first, count, mass, vector(centre), keep(position), keep(rotation)});
    }
    return {std::move(found), keep(twists)};
  }

  double dt_;
  int order_;
  std::vector<nb::object> kept_;  // before what points into it
  hqp::Tree tree_;
  hqp::Kinematics* kinematics_ = nullptr;
  std::unique_ptr<hqp::EquationOfMotion> equation_;
  std::vector<Operation> operations_;
  std::unique_ptr<hqp::Demands> demands_;
  Parts written_, bounded_;
  hqp::KnownLoads loads_;
  hqp::Loop loop_;
  nb::object solve_;
  hqp::SolveCall* call_ = nullptr;
  std::vector<double> sent_;        // x of the latest record
  std::vector<std::int8_t> marks_;  // and its marks
  std::vector<double> state_;       // q, v and, at velocity level, where q comes to
  const double* values_ = nullptr;
  const std::int8_t* active_ = nullptr;
  std::size_t value_count_ = 0, active_count_ = 0;
  Ints command_;
  double largest_ = 0.0;
  hqp::Clock::time_point begin_;
};

}  // namespace binding
