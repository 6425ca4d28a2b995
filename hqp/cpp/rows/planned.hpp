// Make rows from a plan: tree, operations, laws, places of references; from Python or from a file.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "assembly.hpp"
#include "references.hpp"

namespace hqp {

constexpr int kMost = 100'000;  // numbers of a reference, or of a configuration

// On the world, or on one of that many joints.
template <class Plan>
Placed placed(const Plan& plan, std::size_t joints) {
  const std::vector<Plan> p = plan.parts();
  need(p.size() == 4, "a placement has four parts");
  const std::vector<double> turned = p[2].numbers();
  const std::vector<Plan> views = p[3].parts();
  need(turned.size() == 9 && views.size() == 2, "a rotation has nine numbers, a placement two views");
  return {p[0].place(joints + 1), vector(p[1].numbers()), load_rotation(turned.data()), views[0].doubles(3),
          views[1].doubles(9)};
}
template <class Plan>
std::vector<Placed> frames(const Plan& plan, std::size_t joints) {
  std::vector<Placed> found;
  for (const Plan& one : plan.parts()) found.push_back(placed(one, joints));
  return found;
}
template <class Plan>
std::vector<TreeJoint> joints(const Plan& plan, int nv) {
  std::vector<TreeJoint> found;
  for (const Plan& one : plan.parts()) {
    const std::vector<Plan> p = one.parts();
    need(p.size() == 5, "a joint has five parts");
    const auto kind = static_cast<JointKind>(p[0].place(std::size_t(JointKind::kTranslating) + 1));
    const int last = nv - Kinematics::sizes(kind).second;
    found.push_back({kind, p[1].place(kMost), p[2].place(std::size_t(std::max(last + 1, 0))), vector(p[3].numbers()),
                     placed(p[4], found.size())});
  }
  return found;
}
template <class Plan>
std::vector<Body> bodies(const Plan& plan, int nv) {
  std::vector<Body> found;
  for (const Plan& one : plan.parts()) {
    const std::vector<Plan> p = one.parts();
    need(p.size() == 6, "a body has six parts");
    const std::vector<Plan> views = p[5].parts();
    const int parent = p[0].integer(), first = p[1].integer(), count = p[2].integer();
    const bool behind = found.empty() || (parent >= 0 && parent < static_cast<int>(found.size()));
    need(views.size() == 2 && behind && first >= 0 && count >= 0 && first <= nv && count <= nv - first,
         "a body is behind its parent, its columns are the robot's");
    found.push_back({found.empty() ? 0 : parent, first, count, p[3].number(), vector(p[4].numbers()),
                     views[0].doubles(3), views[1].doubles(9)});
  }
  return found;
}

template <class Plan>
Target target(const Plan& p, int nv) {
  const std::size_t m = p.part("error").size(), n = static_cast<std::size_t>(nv), given = p.part("reference").size();
  return {p.maybe("J", m * n),
          p.doubles("error", m),
          p.maybe("drift", m),
          p.doubles("lower", m),
          p.doubles("upper", m),
          p.doubles("reference", given),
          p.maybe("normal", 3),
          p.number("weight"),
          p.has("J") ? nv : 0,
          p.doubles("rate", m),
          p.doubles("feedforward", m),
          m,
          given};
}
template <class Plan>
Laws laws(const Plan& p, int order, int nv) {
  static_assert(sizeof(std::intptr_t) == sizeof(std::int64_t), "plans hold indices of 64 bits");
  const std::size_t total = p.part("error").size(), n = static_cast<std::size_t>(nv), m = p.part("J").size() / n;
  need(m <= total, "there are more rows of J than rows");
  Laws laws{order,
            static_cast<int>(m),
            nv,
            static_cast<int>(total),
            p.doubles("J", m * n),
            p.doubles("error", total),
            p.doubles("rate", total),
            p.doubles("feedforward", total),
            p.doubles("drift", total),
            p.doubles("weight", total),
            reinterpret_cast<const std::intptr_t*>(p.places64("pick", total - m, n)),
            p.part("kind").bytes(total),
            p.doubles("kp", total),
            p.doubles("kd", total),
            p.doubles("demand", total),
            p.doubles("lower", total),
            p.doubles("upper", total),
            {}};
  for (const Plan& one : p.parts("saturations")) {
    const std::vector<double> s = one.numbers();
    need(s.size() == 5 && s[0] >= 0.0 && s[0] <= s[1] && s[1] <= double(total), "a saturation lies outside the rows");
    laws.saturations.push_back({static_cast<int>(s[0]), static_cast<int>(s[1]), s[2], s[3], s[4]});
  }
  return laws;
}
// A law of the element with these rows.
template <class Plan>
RowsLaw rows_law(const Plan& p, int start, int stop) {
  const std::vector<double> held = p.numbers("held", 3);
  const std::size_t rows = std::size_t(stop - start);
  return {
      {start, stop, held[0], held[1], held[2]}, p.numbers("kp", rows), p.numbers("kd", rows), p.numbers("pace", rows)};
}
// Buffers of an element's reference; operations: number of operations.
template <class Plan>
Slot slot(const Plan& p, int operations) {
  Slot slot;
  slot.shape = p.ints("shape");
  std::size_t size = 1;
  for (const int n : slot.shape) {
    need(n >= 0 && n <= kMost, "a reference has a wrong shape");
    size *= static_cast<std::size_t>(n);
  }
  slot.target = p.maybe("target", size);
  slot.elsewhere = !p.has("target");
  slot.normal = p.maybe("normal", 3);
  if (slot.normal) std::copy(slot.normal, slot.normal + 3, slot.usual.begin());
  const std::size_t rows = p.part("rate").size();
  slot.rows = static_cast<int>(rows);
  slot.rate = p.doubles("rate", rows), slot.feedforward = p.doubles("feedforward", rows);
  if (p.has("operation")) slot.operation = p.place("operation", std::size_t(operations));
  slot.plain = static_cast<Plain>(p.place("plain", std::size_t(Plain::kPose) + 1));
  need(size >= (slot.plain == Plain::kPose       ? 16
                : slot.plain == Plain::kRotation ? 9
                                                 : 0),
       "a reference has a wrong shape");
  return slot;
}

// Buffer of a load's reference.
template <class Plan>
Slot load_slot(const Plan& p) {
  const std::size_t size = p.part("value").size();
  const auto plan = p.part("plan");
  const std::size_t expected = plan.name() == "JointLoad"        ? plan.numbers("columns").size()
                               : plan.name() == "NominalTorque"  ? std::size_t(plan.ints("shape").at(0))
                               : plan.name() == "ExternalWrench" ? 6u
                                                                 : 4u;
  need(size == expected, "a load of the plan has another number of values");
  Slot slot;
  slot.target = p.doubles("value", size);
  slot.shape = {static_cast<int>(size)};
  slot.plain = Plain::kNumbers;
  return slot;
}

// A (nv, nv), its upper triangle, and b + g (nv,) are written with every tick, loads included.
template <class Plan>
void add_dynamics(Assembly& rows, const Plan& p) {
  const std::size_t n = static_cast<std::size_t>(rows.size());
  rows.dynamics(p.inertias("inertias"), p.numbers("rotors"), load(p.doubles("gravity", 3)), p.doubles("A", n * n),
                p.doubles("bias", n));
}
// A load whose value is live; payloads count for centres of mass, too.
template <class Plan>
void add_load(Assembly& rows, const Plan& p) {
  const Slot slot = load_slot(p);
  rows.load(p.part("plan"), slot.target);
}

}  // namespace hqp
