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
#include "laws.hpp"
#include "wheels.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Picks = nb::ndarray<const std::intptr_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Ints = std::vector<int>;
using Numbers = std::vector<double>;

using Placement = std::tuple<Vector, Columns>;                                      // position, rotation
using Bodies = std::vector<std::tuple<int, int, int, double, Numbers, Placement>>;  // hqp.robot.Body
using Rows = std::tuple<Block, Written, std::optional<Written>, Vector, double>;  // J, error, drift, reference, weight
using Frame = std::tuple<Placement, int, Ints>;                                   // placement, body, columns
using Observer = std::tuple<Frame, bool, double>;                                 // frame, heading, upright

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
    add(std::make_unique<hqp::Wheel>(seen(rows, f, {}), keep(normal), radius, vector(axle), std::move(picked),
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
           Numbers speed, Numbers acceleration, Numbers braking, double return_velocity, double dt, int order) {
    hqp::Limits limits{std::move(positions),
                       std::move(columns),
                       std::move(low),
                       std::move(high),
                       std::move(speed),
                       std::move(acceleration),
                       std::move(braking),
                       return_velocity,
                       dt,
                       order};
    add(std::make_unique<hqp::Box>(keep(lower), keep(upper), std::move(limits)));
  }
  void laws(int order, const Block& J, const Vector& error, const Vector& rate, const Vector& feedforward,
            const Vector& drift, const Vector& kp, const Vector& kd, const Vector& weight, const Picks& pick,
            const Flags& equality, const Written& demand, const Written& lower, const Written& upper,
            const std::vector<std::tuple<int, int, double, double, double>>& saturations) {
    hqp::Laws laws{order,
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
                   keep(equality),
                   keep(demand),
                   keep(lower),
                   keep(upper),
                   {}};
    for (const auto& [start, stop, fastest, hardest, damping] : saturations)
      laws.saturations.push_back({start, stop, fastest, hardest, damping});
    demands_ = std::make_unique<hqp::Demands>(std::move(laws));
  }
  void run(const Vector& q, const Vector& v) {
    tree_.update(v.data());
    for (const auto& operation : operations_) operation->run(q.data(), v.data());
  }
  void demand(const Vector& v) { demands_->run(v.data()); }

 private:
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
  hqp::Target target(const Rows& rows) {
    auto [J, error, drift, reference, weight] = rows;
    if (drift) tree_.need_motions();
    return {keep(J),         keep(error), drift ? keep(*drift) : nullptr,
            keep(reference), weight,      static_cast<int>(J.shape(1))};
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
  std::unique_ptr<hqp::Demands> demands_;
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
           "columns"_a, "low"_a, "high"_a, "speed"_a, "acceleration"_a, "braking"_a, "return_velocity"_a, "dt"_a,
           "order"_a)
      .def("laws", &Assembly::laws, nb::kw_only(), "order"_a, "J"_a.noconvert(), "error"_a.noconvert(),
           "rate"_a.noconvert(), "feedforward"_a.noconvert(), "drift"_a.noconvert(), "kp"_a.noconvert(),
           "kd"_a.noconvert(), "weight"_a.noconvert(), "pick"_a.noconvert(), "equality"_a.noconvert(),
           "demand"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert(), "saturations"_a)
      .def("run", &Assembly::run, "q"_a, "v"_a)
      .def("demand", &Assembly::demand, "v"_a);
}
