// Field-by-field access to a plan: from an object of hqp/declare/plans.py, or from a file.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "../dynamics/inertia.hpp"
#include "barrier.hpp"
#include "directions.hpp"
#include "joints.hpp"
#include "relative_frame.hpp"

namespace hqp {

inline void need(bool right, const char* what) {
  if (!right) throw std::invalid_argument(what);
}
inline Vec3 vector(const std::vector<double>& a) {
  need(a.size() == 3, "a vector has three numbers");
  return load(a.data());
}

// Self reads: name() of the plan's class; is_none(), number(), integer(), flag(), ints(), numbers(), of itself;
// has(field), part(field), texts(field) and parts(), for its fields; doubles(count), longs(count), bytes(count) and
// size(), live arrays.
template <class Self>
class PlanOf {
 public:
  double number(const char* field) const { return part(field).number(); }
  int integer(const char* field) const { return part(field).integer(); }
  bool flag(const char* field) const { return part(field).flag(); }
  std::vector<int> ints(const char* field) const { return part(field).ints(); }
  std::vector<double> numbers(const char* field) const { return part(field).numbers(); }
  std::vector<double> numbers(const char* field, std::size_t count) const {
    std::vector<double> found = numbers(field);
    if (found.size() != count) throw std::invalid_argument(std::string(field) + " has a wrong size");
    return found;
  }
  // One of `count` things, by its place; for a list, each of its entries.
  int place(std::size_t count) const { return checked(self().integer(), count); }
  std::vector<int> places(std::size_t count) const {
    std::vector<int> found = self().ints();
    for (const int at : found) checked(at, count);
    return found;
  }
  const std::int64_t* places64(const char* field, std::size_t size, std::size_t count) const {
    const std::int64_t* found = part(field).longs(size);
    for (std::size_t i = 0; i < size; ++i)
      if (found[i] < 0 || std::size_t(found[i]) >= count)
        throw std::invalid_argument("a place of the plan is not an index");
    return found;
  }
  int place(const char* field, std::size_t count) const { return part(field).place(count); }
  std::vector<int> places(const char* field, std::size_t count) const { return part(field).places(count); }
  Vec3 vec3(const char* field) const { return vector(numbers(field)); }
  std::vector<Self> parts(const char* field) const { return part(field).parts(); }
  double* doubles(const char* field, std::size_t count) const { return part(field).doubles(count); }
  double* maybe(const char* field, std::size_t count) const {  // null for none
    return self().has(field) ? part(field).doubles(count) : nullptr;
  }

  Frame frame(const Tree& tree) const {
    return {doubles("position", 3), doubles("rotation", 9), place("body", tree.bodies().size()),
            places("columns", std::size_t(tree.size()))};
  }
  Frame frame(const char* field, const Tree& tree) const { return part(field).frame(tree); }
  RelativeFrame relative(const Tree& tree) const {
    const Self other = part("relative_to");
    if (other.is_none()) return {};
    return {other.frame("frame", tree), other.flag("heading"), other.number("upright")};
  }
  // Joints of a robot of nv coordinates whose configuration has nq numbers.
  Joints joints(std::size_t nv, std::size_t nq) const {
    std::vector<bool> continuous;
    for (const Self& one : parts("continuous")) continuous.push_back(one.flag());
    const std::size_t last = nq - (std::find(continuous.begin(), continuous.end(), true) != continuous.end());
    Joints found{places("columns", nv), places("positions", nq), std::move(continuous)};
    if (found.positions.size() != found.size() || found.continuous.size() != found.size())
      throw std::invalid_argument("joints have a place and a kind each");
    for (std::size_t i = 0; i < found.size(); ++i)
      if (found.continuous[i]) checked(found.positions[i], last);
    return found;
  }
  Axis axis() const { return {vec3("axis"), vec3("first"), vec3("other")}; }
  Barrier barrier(double dt) const { return {number("rate"), number("recovery"), number("outset"), dt}; }
  std::vector<BodyInertia> inertias(const char* field) const {
    std::vector<BodyInertia> found;
    for (const Self& one : parts(field)) found.push_back(one.inertia());
    return found;
  }
  BodyInertia inertia() const {
    const std::vector<double> given = self().numbers();
    if (given.size() != 6) throw std::invalid_argument("an inertia has six numbers");
    BodyInertia found;
    std::copy(given.begin(), given.end(), found.begin());
    return found;
  }

 private:
  static int checked(int at, std::size_t count) {
    if (at < 0 || std::size_t(at) >= count)
      throw std::invalid_argument("the plan has no field " + std::to_string(at) + " among " + std::to_string(count));
    return at;
  }
  const Self& self() const { return static_cast<const Self&>(*this); }
  Self part(const char* field) const { return self().part(field); }
};

}  // namespace hqp
