// The operation that a plan of hqp/declare/plans.py asks for, by the name of its class.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "balance.hpp"
#include "collision.hpp"
#include "com.hpp"
#include "frames.hpp"
#include "holding_torque.hpp"
#include "kinetic_energy.hpp"
#include "manipulability.hpp"
#include "momentum.hpp"
#include "plan.hpp"
#include "wheels.hpp"

namespace hqp {

struct UnknownPlan : std::invalid_argument {
  explicit UnknownPlan(const std::string& name)
      : std::invalid_argument("no native operation for a plan of class " + name) {}
};

class Operations {
 public:
  using Made = std::unique_ptr<Operation>;

  Operations(Tree& tree, double dt, int order) : tree_(tree), dt_(dt), order_(order) {}

  template <class Plan>
  Made make(const Plan& p, const Target& out) {
    const std::string name = p.name();
    const auto rows = [&] { return Rows(out, tree_, p.frame("frame"), p.relative()); };
    const auto fixed = [&] { return Rows(out, tree_, p.frame("frame"), {}); };
    if (name == "Point") return std::make_unique<Point>(rows(), p.ints("axes"), p.vec3("offset"));
    if (name == "Pose") return std::make_unique<Pose>(rows());
    if (name == "Rotation") return std::make_unique<Rotation>(rows());
    if (name == "Angles") return std::make_unique<Angles>(rows(), p.ints("picked"), p.number("gimbal"));
    if (name == "Edge") return std::make_unique<Edge>(fixed(), p.vec3("axis"), p.vec3("first"), p.vec3("other"));
    if (name == "Wheel") {
      if (!out.normal) throw std::invalid_argument("a wheel needs the ground's normal");
      return std::make_unique<Wheel>(fixed(), p.number("radius"), p.vec3("axle"), p.ints("picked"),
                                     p.number("aligned"));
    }
    if (name == "Com") {
      tree_.need_centres();
      return std::make_unique<Com>(Rows(out, tree_, {}, p.relative()), p.integer("part"), p.ints("axes"));
    }
    if (name == "Momentum") {
      tree_.need_centres();
      return std::make_unique<Momentum>(out, tree_, p.ints("picked"), p.inertias("inertias"));
    }
    if (name == "KineticEnergy")
      return std::make_unique<KineticEnergy>(out, tree_, p.inertias("inertias"), p.numbers("rotors"));
    if (name == "Joints") return std::make_unique<Posture>(out, p.joints());
    if (name == "Coupling") return std::make_unique<Coupling>(out, p.joints("joints"), p.numbers("coefficients"));
    if (name == "JointBox") return std::make_unique<JointBox>(out, p.joints("joints"), limits(p));
    if (name == "Still") return std::make_unique<Still>(out, p.ints("columns"));
    if (name == "Steady") return std::make_unique<Steady>(out, p.ints("columns"), order_);
    if (name == "Frozen")
      return std::make_unique<Frozen>(out, p.joints("joints"), p.number("rate"), p.number("acceleration"), dt_, order_);
    if (name == "Pointing") return std::make_unique<Pointing>(fixed(), p.axis(), p.flag("point"));
    if (name == "Apart") return std::make_unique<Apart>(rows());
    if (name == "Manipulability") return std::make_unique<Manipulability>(fixed(), p.ints("picked"), p.ints("joints"));
    if (name == "HoldingTorque") {
      tree_.need_centres();
      return std::make_unique<HoldingTorque>(out, tree_, p.ints("columns"), p.numbers("limits"), p.vec3("gravity"));
    }
    if (name == "Cone")
      return std::make_unique<Cone>(fixed(), p.axis(), p.flag("point"), p.number("angle"), p.barrier(dt_), order_);
    if (name == "Within") return within(p, out);
    if (name == "SupportPolygon") return support_polygon(p, out);
    if (name == "Balance") return balance(p, out);
    if (name == "Collision") return std::make_unique<Collision>(out, tree_, scene(p));
    throw UnknownPlan(name);
  }

 private:
  template <class Plan>
  Limits limits(const Plan& p) const {
    return {p.numbers("low"),
            p.numbers("high"),
            p.numbers("speed"),
            p.numbers("acceleration"),
            p.numbers("braking"),
            p.number("approach"),
            p.number("return_velocity"),
            dt_,
            order_};
  }

  template <class Plan>
  Made within(const Plan& p, const Target& out) {
    std::vector<double> low = p.numbers("lower");
    const int m = static_cast<int>(low.size()), nv = tree_.size();
    auto own = std::make_unique<Numbers>(m, out.J ? 0 : nv);
    const bool rates = p.flag("rates");
    const Target inner = own->target(out.J, rates ? nullptr : out.reference, out.weight, nv, order_ == 2);
    Made task = make(p.part("task"), inner);
    return std::make_unique<Within>(out, std::move(own), std::move(task), std::move(low), p.numbers("upper"),
                                    p.barrier(dt_), rates, p.integer("turn"), nv, order_);
  }

  std::unique_ptr<Com> centre(const Target& inner) {
    tree_.need_centres();
    return std::make_unique<Com>(Rows(inner, tree_, {}, {}), 0, std::vector<int>{0, 1});
  }

  template <class Plan>
  static std::vector<Corner> points(const Plan& p) {
    std::vector<Corner> found;
    const std::vector<Plan> points = p.parts("points");
    const std::int8_t* present = p.part("present").bytes(points.size());
    for (const Plan& one : points) {
      const std::vector<Plan> pair = one.parts();
      if (pair.size() != 2) throw std::invalid_argument("a corner is a frame and a point");
      found.push_back({false, pair[0].frame(), vector(pair[1].numbers()), present + found.size()});
    }
    return found;
  }

  template <class Plan>
  Made support_polygon(const Plan& p, const Target& out) {
    const int nv = tree_.size();
    auto own = std::make_unique<Numbers>(2, nv);
    auto com = centre(own->target(nullptr, nullptr, 1.0, nv, order_ == 2));
    std::vector<Corner> corners = points(p);
    for (const Plan& one : p.parts("polygon")) {
      const std::vector<double> corner = one.numbers();
      if (corner.size() != 2) throw std::invalid_argument("a corner of a polygon has two numbers");
      corners.push_back({true, {}, {corner[0], corner[1], 0.0}});
    }
    return std::make_unique<SupportPolygon>(out, std::move(own), std::move(com), std::move(corners), p.number("margin"),
                                            p.barrier(dt_), order_);
  }

  template <class Plan>
  Made balance(const Plan& p, const Target& out) {
    const int nv = tree_.size();
    auto own = std::make_unique<Numbers>(2, 0);
    auto com = centre(own->target(out.J, nullptr, out.weight, nv, order_ == 2));
    return std::make_unique<Balance>(out, std::move(own), std::move(com), points(p), p.number("k"), p.number("height"),
                                     p.number("gravity"), tree_);
  }

  template <class Plan>
  CollisionScene scene(const Plan& p) {
    CollisionScene found;
    for (const Plan& link : p.parts("links")) {
      const std::vector<Plan> part = link.parts();
      const std::vector<double> ends = part.size() == 3 ? part[1].numbers() : std::vector<double>();
      if (ends.size() != 6) throw std::invalid_argument("a capsule has two ends");
      found.links.push_back({part[0].integer(), {load(ends.data()), load(ends.data() + 3)}, part[2].number()});
    }
    for (const Plan& shape : p.parts("world")) {
      const std::vector<Plan> part = shape.parts();
      if (part.size() != 2) throw std::invalid_argument("a shape of the world is a kind and a size");
      found.world.push_back({static_cast<Solid>(part[0].integer()), vector(part[1].numbers())});
    }
    for (const Plan& chain : p.parts("chains")) found.chains.push_back(chain.ints());
    for (const Plan& pair : p.parts("pairs")) {
      const std::vector<int> both = pair.ints();
      if (both.size() != 2) throw std::invalid_argument("a pair is of two shapes");
      found.pairs.push_back({both[0], both[1]});
    }
    found.clearances = p.numbers("clearances");
    found.slots = p.part("slots").places(found.rows);
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

  Tree& tree_;
  double dt_;
  int order_;
};

}  // namespace hqp
