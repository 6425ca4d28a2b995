// Make the operation of a plan of hqp/declare/plans.py, by the name of its class.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "balance.hpp"
#include "collision.hpp"
#include "com.hpp"
#include "frame_speed.hpp"
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

  Operations(Tree& tree, int nq, double dt, int order)
      : tree_(tree), nv_(std::size_t(tree.size())), nq_(std::size_t(nq)), dt_(dt), order_(order) {}

  template <class Plan>
  Made make(const Plan& p, const Target& out) {
    const std::string name = p.name();
    const auto rows = [&] { return Rows(out, tree_, p.frame("frame", tree_), p.relative(tree_)); };
    const auto fixed = [&] { return Rows(out, tree_, p.frame("frame", tree_), {}); };
    const auto fits = [&](std::size_t rows, std::size_t given) { fit(out, rows, given); };
    const auto picked = [&](const char* field, std::size_t count, bool referenced = true) {  // a row each
      std::vector<int> found = p.places(field, count);
      fits(found.size(), referenced ? found.size() : 0);
      return found;
    };
    const auto joints = [&](const Plan& plan, bool referenced = true) {
      Joints found = plan.joints(nv_, nq_);
      fits(found.size(), referenced ? found.size() : 0);
      return found;
    };
    if (name == "Joints") return std::make_unique<Posture>(out, joints(p));
    if (name == "Coupling") {
      fits(1, 1);
      Joints related = p.part("joints").joints(nv_, nq_);
      std::vector<double> coefficients = p.numbers("coefficients", related.size());
      return std::make_unique<Coupling>(out, std::move(related), std::move(coefficients));
    }
    if (name == "JointBox") {
      Joints held = joints(p.part("joints"), false);
      Limits box = limits(p, held.size());
      return std::make_unique<JointBox>(out, std::move(held), std::move(box));
    }
    if (name == "Still") return std::make_unique<Still>(out, picked("columns", nv_, false));
    if (name == "Steady") return std::make_unique<Steady>(out, picked("columns", nv_, false), order_);
    if (name == "Prescribed") {
      if (!out.feedforward) throw std::invalid_argument("a prescribed motion of the plan has no acceleration");
      return std::make_unique<Prescribed>(out, picked("columns", nv_), dt_, order_);
    }
    if (name == "Frozen")
      return std::make_unique<Frozen>(out, joints(p.part("joints")), p.number("rate"), p.number("acceleration"), dt_,
                                      order_);
    if (name == "Within") return within(p, out);
    if (!out.J && out.rows > 0) throw std::invalid_argument("an element of the plan has rows but no Jacobian");
    if (name == "Point") return std::make_unique<Point>(rows(), picked("axes", 3), p.vec3("offset"));
    if (name == "Pose") return fits(6, 16), std::make_unique<Pose>(rows());
    if (name == "Rotation") return fits(3, 9), std::make_unique<Rotation>(rows());
    if (name == "Angles") return std::make_unique<Angles>(rows(), picked("picked", 3), p.number("gimbal"));
    if (name == "Edge")
      return fits(5, 6), std::make_unique<Edge>(fixed(), p.vec3("axis"), p.vec3("first"), p.vec3("other"));
    if (name == "Hinge")
      return fits(5, 6), std::make_unique<Hinge>(rows(), p.vec3("axis"), p.vec3("first"), p.vec3("other"));
    if (name == "Wheel") {
      std::vector<int> directions = picked("picked", 3, false);
      if (!out.normal || directions.empty()) throw std::invalid_argument("a wheel of the plan has no ground normal");
      fits(directions.size(), 3);
      return std::make_unique<Wheel>(fixed(), p.number("radius"), p.vec3("axle"), std::move(directions),
                                     p.number("aligned"));
    }
    if (name == "Com") {
      tree_.need_centres();
      return std::make_unique<Com>(Rows(out, tree_, {}, p.relative(tree_)), p.place("part", tree_.bodies().size()),
                                   picked("axes", 3));
    }
    if (name == "Momentum") {
      tree_.need_centres();
      return std::make_unique<Momentum>(out, tree_, picked("picked", 6, false), p.inertias("inertias"));
    }
    if (name == "KineticEnergy")
      return fits(nv_, 0),
             std::make_unique<KineticEnergy>(out, tree_, p.inertias("inertias"), p.numbers("rotors", nv_));
    if (name == "Pointing") return fits(2, 3), std::make_unique<Pointing>(fixed(), p.axis(), p.flag("point"));
    if (name == "Apart") return fits(1, 1), std::make_unique<Apart>(rows());
    if (name == "Manipulability") {
      fits(1, 1);
      const std::vector<int> of = p.places("picked", 6);
      if (of.size() > 6) throw std::invalid_argument("a Jacobian of a frame has six rows");
      return std::make_unique<Manipulability>(fixed(), of, p.places("joints", nv_));
    }
    if (name == "HoldingTorque") {
      tree_.need_centres();
      const std::vector<int> columns = picked("columns", nv_);
      return std::make_unique<HoldingTorque>(out, tree_, columns, p.numbers("limits", columns.size()),
                                             p.vec3("gravity"));
    }
    if (name == "Cone") {
      fits(1, 9);
      return std::make_unique<Cone>(fixed(), p.axis(), p.flag("point"), p.number("angle"), p.barrier(dt_), order_);
    }
    if (name == "FrameSpeed") return frame_speed(p, out, fixed());
    if (name == "SupportPolygon") return support_polygon(p, out);
    if (name == "Balance") return balance(p, out);
    if (name == "Collision") {
      CollisionScene found = scene(p);
      fit(out, std::size_t(found.rows), 24 * found.world.size());
      return std::make_unique<Collision>(out, tree_, std::move(found));
    }
    throw UnknownPlan(name);
  }

 private:
  // Refuses rows, or numbers of a reference, that are fewer than an operation's.
  static void fit(const Target& out, std::size_t rows, std::size_t given) {
    if (out.rows != rows || out.given < given)
      throw std::invalid_argument("an element of the plan has other rows than its operation");
  }

  template <class Plan>
  Limits limits(const Plan& p, std::size_t count) const {
    return {p.numbers("low", count),
            p.numbers("high", count),
            p.numbers("speed", count),
            p.numbers("acceleration", count),
            p.numbers("braking", count),
            p.number("approach"),
            p.number("return_velocity"),
            p.number("noise"),
            dt_,
            order_};
  }

  template <class Plan>
  Made within(const Plan& p, const Target& out) {
    std::vector<double> low = p.numbers("lower");
    const int m = static_cast<int>(low.size()), nv = tree_.size(), turn = p.integer("turn");
    fit(out, low.size(), 0);
    if ((turn >= 0 && turn > m - 3) || !out.rate || !out.feedforward)
      throw std::invalid_argument("a bound of the plan has other rows than its element");
    auto own = std::make_unique<Numbers>(m, out.J ? 0 : nv);
    const bool rates = p.flag("rates");
    const Target inner = own->target(out.J, rates ? nullptr : out.reference, out.given, out.weight, nv, order_ == 2);
    Made task = make(p.part("task"), inner);
    return std::make_unique<Within>(out, std::move(own), std::move(task), std::move(low),
                                    p.numbers("upper", std::size_t(m)), p.barrier(dt_), rates, turn, nv, order_);
  }

  template <class Plan>
  Made frame_speed(const Plan& p, const Target& out, Rows rows) {
    tree_.need_motions();
    std::vector<Vec3> normals;
    for (const Plan& one : p.parts("normals")) normals.push_back(vector(one.numbers()));
    const double linear = p.number("linear"), angular = p.number("angular");
    fit(out, normals.size() * (std::size_t(std::isfinite(linear)) + std::size_t(std::isfinite(angular))), 0);
    return std::make_unique<FrameSpeed>(std::move(rows), std::move(normals), linear, angular, p.number("rate"), dt_,
                                        order_);
  }

  std::unique_ptr<Com> centre(const Target& inner) {
    tree_.need_centres();
    return std::make_unique<Com>(Rows(inner, tree_, {}, {}), 0, std::vector<int>{0, 1});
  }

  template <class Plan>
  std::vector<Corner> points(const Plan& p) const {
    std::vector<Corner> found;
    const std::vector<Plan> points = p.parts("points");
    const std::vector<std::string> of = p.texts("of");
    if (!of.empty() && of.size() != points.size()) throw std::invalid_argument("a corner of the plan names no contact");
    for (const Plan& one : points) {
      const std::vector<Plan> pair = one.parts();
      if (pair.size() != 2) throw std::invalid_argument("a corner is a frame and a point");
      found.push_back({false, pair[0].frame(tree_), vector(pair[1].numbers()), of.empty() ? "" : of[found.size()]});
    }
    return found;
  }

  template <class Plan>
  Made support_polygon(const Plan& p, const Target& out) {
    const int nv = tree_.size();
    auto own = std::make_unique<Numbers>(2, nv);
    auto com = centre(own->target(nullptr, nullptr, 0, 1.0, nv, order_ == 2));
    std::vector<Corner> corners = points(p);
    for (const Plan& one : p.parts("polygon")) {
      const std::vector<double> corner = one.numbers();
      if (corner.size() != 2) throw std::invalid_argument("a corner of a polygon has two numbers");
      corners.push_back({true, {}, {corner[0], corner[1], 0.0}});
    }
    fit(out, corners.size(), 2 * p.parts("polygon").size());
    return std::make_unique<SupportPolygon>(out, std::move(own), std::move(com), std::move(corners), p.number("margin"),
                                            p.barrier(dt_), order_);
  }

  template <class Plan>
  Made balance(const Plan& p, const Target& out) {
    const int nv = tree_.size();
    fit(out, 2, 4);
    auto own = std::make_unique<Numbers>(2, 0);
    auto com = centre(own->target(out.J, nullptr, 0, out.weight, nv, order_ == 2));
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
      found.links.push_back(
          {part[0].place(tree_.bodies().size()), {load(ends.data()), load(ends.data() + 3)}, part[2].number()});
    }
    for (const Plan& hull : p.parts("hulls")) {
      const std::vector<Plan> part = hull.parts();
      if (part.size() != 4) throw std::invalid_argument("a hull is a link, a radius, corners and triangles");
      const std::vector<double> numbers = part[2].numbers();
      std::vector<Vec3> corners;
      for (std::size_t k = 0; k + 2 < numbers.size(); k += 3) corners.push_back(load(&numbers[k]));
      found.links[part[0].place(found.links.size())].hull.emplace(corners, part[3].places(corners.size()),
                                                                  part[1].number());
    }
    for (const Plan& shape : p.parts("world")) {
      const std::vector<Plan> part = shape.parts();
      if (part.size() != 2) throw std::invalid_argument("a shape of the world is a kind and a size");
      found.world.push_back({static_cast<Solid>(part[0].place(3)), vector(part[1].numbers())});
    }
    found.names = p.texts("names");
    if (found.names.size() != found.links.size() + found.world.size())
      throw std::invalid_argument("a name for every shape is needed");
    for (const Plan& chain : p.parts("chains")) found.chains.push_back(chain.places(nv_));
    if (found.chains.size() != tree_.bodies().size()) throw std::invalid_argument("a chain for every body is needed");
    for (const Plan& pair : p.parts("pairs")) {
      const std::vector<int> both = pair.places(found.links.size() + found.world.size());
      if (both.size() != 2 || std::size_t(both[0]) >= found.links.size() || found.links[both[0]].hull)
        throw std::invalid_argument("a pair is of a capsule of a link and another shape");
      found.pairs.push_back({both[0], both[1]});
    }
    found.clearances = p.numbers("clearances", found.pairs.size());
    found.slots = p.part("slots").slots(found.rows);
    for (int k = 0; k < found.rows; ++k)
      if (found.slots[k] < -1 || found.slots[k] >= 5 * static_cast<int>(found.pairs.size()))
        throw std::invalid_argument("a row is of no pair");
    if (found.rows == 0 && !found.pairs.empty()) throw std::invalid_argument("pairs have no row");
    found.influence = p.number("influence");
    found.soft = p.number("soft");
    found.curvature = p.number("curvature");
    found.rate = p.number("rate");
    found.braking = p.number("braking");
    found.approach = p.number("approach");
    found.foresight = p.number("foresight");
    found.recovery = p.number("recovery");
    found.outset = p.number("outset");
    found.step = p.number("step");
    found.dt = dt_;
    found.order = order_;
    tree_.need_motions();
    return found;
  }

  Tree& tree_;
  std::size_t nv_, nq_;
  double dt_;
  int order_;
};

}  // namespace hqp
