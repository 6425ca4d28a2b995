// Python's view of the row operations: they are added once, when a stack is compiled, and run together each tick.
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "com.hpp"
#include "frames.hpp"
#include "joints.hpp"
#include "wheels.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Ints = std::vector<int>;
using Numbers = std::vector<double>;

using Placement = std::tuple<Vector, Columns>;                                  // position, rotation
using Bodies = std::vector<std::tuple<int, int, int, double, Numbers, Placement>>;  // hqp.robot.Body
using Rows = std::tuple<Block, Written, std::optional<Written>, Vector, double>;   // J, error, drift, reference, weight
using Frame = std::tuple<Placement, int, Ints>;                                 // placement, body, columns
using Observer = std::tuple<Frame, bool, double>;                               // frame, heading, upright

hqp::Vec3 vector(const Numbers& a) {
  if (a.size() != 3) throw nb::value_error("a vector has three numbers");
  return hqp::load(a.data());
}

class Assembly {
 public:
  Assembly(const Columns& twists, const Bodies& bodies) : tree_(tree(twists, bodies)) {}
  Assembly(const Assembly&) = delete;

  void point(const Rows& rows, const Frame& f, const std::optional<Observer>& o, Ints axes, const Numbers& offset) {
    add(std::make_unique<hqp::Point>(seen(rows, f, o), std::move(axes), vector(offset)));
  }
  void pose(const Rows& rows, const Frame& f, const std::optional<Observer>& o) {
    add(std::make_unique<hqp::Pose>(seen(rows, f, o)));
  }
  void rotation(const Rows& rows, const Frame& f, const std::optional<Observer>& o) {
    add(std::make_unique<hqp::Rotation>(seen(rows, f, o)));
  }
  void angles(const Rows& rows, const Frame& f, const std::optional<Observer>& o, Ints picked, double gimbal) {
    add(std::make_unique<hqp::Angles>(seen(rows, f, o), std::move(picked), gimbal));
  }
  void edge(const Rows& rows, const Frame& f, const Numbers& axis, const Numbers& first, const Numbers& other) {
    add(std::make_unique<hqp::Edge>(seen(rows, f, {}), vector(axis), vector(first), vector(other)));
  }
  void wheel(const Rows& rows, const Frame& f, const Vector& normal, double radius, const Numbers& axle, Ints picked,
             double aligned) {
    keep(normal);
    add(std::make_unique<hqp::Wheel>(seen(rows, f, {}), normal.data(), radius, vector(axle), std::move(picked),
                                     aligned));
  }
  void com(const Rows& rows, const std::optional<Observer>& o, int part, Ints axes) {
    tree_.need_centres();
    hqp::Rows seen{target(rows), tree_, hqp::Frame{}, observer(o)};
    add(std::make_unique<hqp::Com>(std::move(seen), part, std::move(axes)));
  }
  void joints(const Rows& rows, Ints positions) {
    add(std::make_unique<hqp::Joints>(target(rows), std::move(positions)));
  }
  void coupling(const Rows& rows, Ints positions, Numbers coefficients) {
    add(std::make_unique<hqp::Coupling>(target(rows), std::move(positions), std::move(coefficients)));
  }
  void box(const Written& lower, const Written& upper, Ints positions, Ints columns, Numbers low, Numbers high,
           Numbers speed, double acceleration, double return_velocity, double dt, int order) {
    keep(lower);
    keep(upper);
    hqp::Limits limits{std::move(positions), std::move(columns), std::move(low), std::move(high), std::move(speed),
                       acceleration,         return_velocity,    dt,             order};
    add(std::make_unique<hqp::Box>(lower.data(), upper.data(), std::move(limits)));
  }
  void run(const Vector& q, const Vector& v) {
    tree_.update(v.data());
    for (const auto& operation : operations_) operation->run(q.data(), v.data());
  }

 private:
  template <typename Array>
  const double* keep(const Array& array) {
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
  hqp::Target target(const Rows& rows) {
    auto [J, error, drift, reference, weight] = rows;
    keep(J);
    keep(error);
    keep(reference);
    if (drift) keep(*drift);
    if (drift) tree_.need_motions();
    return {J.data(), error.data(), drift ? drift->data() : nullptr, reference.data(), weight,
            static_cast<int>(J.shape(1))};
  }
  hqp::Frame frame(const Frame& given) {
    const auto& [placement, body, columns] = given;
    return {keep(std::get<0>(placement)), keep(std::get<1>(placement)), body, columns};
  }
  hqp::Observer observer(const std::optional<Observer>& given) {
    if (!given) return {};
    return {frame(std::get<0>(*given)), std::get<1>(*given), std::get<2>(*given)};
  }
  hqp::Rows seen(const Rows& rows, const Frame& f, const std::optional<Observer>& o) {
    return {target(rows), tree_, frame(f), observer(o)};
  }
  void add(std::unique_ptr<hqp::Operation> operation) { operations_.push_back(std::move(operation)); }

  std::vector<nb::object> kept_;  // before what points into it
  hqp::Tree tree_;
  std::vector<std::unique_ptr<hqp::Operation>> operations_;
};

}  // namespace

NB_MODULE(_assembly, module) {
  module.doc() = "Rows of the common tasks, written by one call a tick.";
  // Live arrays must be taken as they are: a converted copy would never change.
  const auto rows = "rows"_a.noconvert();
  const auto frame = "frame"_a.noconvert();
  const auto observer = "observer"_a.noconvert().none();
  nb::class_<Assembly>(module, "Assembly")
      .def(nb::init<const Columns&, const Bodies&>(), "twists"_a.noconvert(), "bodies"_a.noconvert())
      .def("point", &Assembly::point, nb::kw_only(), rows, frame, observer, "axes"_a, "offset"_a)
      .def("pose", &Assembly::pose, nb::kw_only(), rows, frame, observer)
      .def("rotation", &Assembly::rotation, nb::kw_only(), rows, frame, observer)
      .def("angles", &Assembly::angles, nb::kw_only(), rows, frame, observer, "picked"_a, "gimbal"_a)
      .def("edge", &Assembly::edge, nb::kw_only(), rows, frame, "axis"_a, "first"_a, "other"_a)
      .def("wheel", &Assembly::wheel, nb::kw_only(), rows, frame, "normal"_a.noconvert(), "radius"_a, "axle"_a,
           "picked"_a, "aligned"_a)
      .def("com", &Assembly::com, nb::kw_only(), rows, observer, "part"_a, "axes"_a)
      .def("joints", &Assembly::joints, nb::kw_only(), rows, "positions"_a)
      .def("coupling", &Assembly::coupling, nb::kw_only(), rows, "positions"_a, "coefficients"_a)
      .def("box", &Assembly::box, nb::kw_only(), "lower"_a.noconvert(), "upper"_a.noconvert(), "positions"_a,
           "columns"_a, "low"_a, "high"_a, "speed"_a, "acceleration"_a, "return_velocity"_a, "dt"_a, "order"_a)
      .def("run", &Assembly::run, "q"_a, "v"_a);
}
