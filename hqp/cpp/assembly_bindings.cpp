// Python's view of the row operations: they are added once, when a stack is compiled, and run together each tick.
#include <memory>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include "assembly.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Ints = std::vector<int>;

std::vector<double> copy(const Vector& a) { return {a.data(), a.data() + a.shape(0)}; }

class Assembly {
 public:
  Assembly() = default;
  Assembly(const Assembly&) = delete;
  void point(Block J, Written error, Vector reference, double weight, Vector position, Columns rotation,
             Columns twists, Ints columns, Ints axes, std::vector<double> offset) {
    keep(J, error, reference, position, rotation, twists);
    if (offset.size() != 3) throw nb::value_error("offset must have three numbers");
    add(std::make_unique<hqp::Point>(target(J, error, reference, weight),
                                     frame(position, rotation, twists, columns), axes, offset.data()));
  }
  void pose(Block J, Written error, Vector reference, double weight, Vector position, Columns rotation, Columns twists,
            Ints columns) {
    keep(J, error, reference, position, rotation, twists);
    add(std::make_unique<hqp::Pose>(target(J, error, reference, weight), frame(position, rotation, twists, columns)));
  }
  void rotation(Block J, Written error, Vector reference, double weight, Vector position, Columns rotation,
                Columns twists, Ints columns) {
    keep(J, error, reference, position, rotation, twists);
    add(std::make_unique<hqp::Rotation>(target(J, error, reference, weight),
                                        frame(position, rotation, twists, columns)));
  }
  void angles(Block J, Written error, Vector reference, double weight, Vector position, Columns rotation,
              Columns twists, Ints columns, Ints picked, double gimbal) {
    keep(J, error, reference, position, rotation, twists);
    add(std::make_unique<hqp::Angles>(target(J, error, reference, weight),
                                      frame(position, rotation, twists, columns), picked, gimbal));
  }
  void com(Block J, Written error, Vector reference, double weight, Vector com, Columns jacobian, Ints axes) {
    keep(J, error, reference, com, jacobian);
    add(std::make_unique<hqp::Com>(target(J, error, reference, weight), com.data(), jacobian.data(), axes));
  }
  void joints(Block J, Written error, Vector reference, double weight, Ints positions) {
    keep(J, error, reference);
    add(std::make_unique<hqp::Joints>(target(J, error, reference, weight), positions));
  }
  void box(Written lower, Written upper, Ints positions, Ints columns, Vector low, Vector high, Vector speed,
           double acceleration, double return_velocity, double dt, int order) {
    keep(lower, upper);
    hqp::Limits limits{positions,    columns,        copy(low), copy(high), copy(speed),
                       acceleration, return_velocity, dt,        order};
    add(std::make_unique<hqp::Box>(lower.data(), upper.data(), std::move(limits)));
  }
  void run(Vector q, Vector v) {
    for (const auto& operation : operations_) operation->run(q.data(), v.data());
  }

 private:
  template <typename... Arrays>
  void keep(const Arrays&... arrays) {
    (kept_.push_back(nb::cast(arrays)), ...);
  }
  static hqp::Target target(const Block& J, const Written& error, const Vector& reference, double weight) {
    return {J.data(), error.data(), reference.data(), weight, static_cast<int>(J.shape(1))};
  }
  static hqp::Frame frame(const Vector& position, const Columns& rotation, const Columns& twists, const Ints& columns) {
    return {position.data(), rotation.data(), twists.data(), columns};
  }
  void add(std::unique_ptr<hqp::Operation> operation) { operations_.push_back(std::move(operation)); }

  std::vector<std::unique_ptr<hqp::Operation>> operations_;
  std::vector<nb::object> kept_;
};

}  // namespace

NB_MODULE(_assembly, module) {
  module.doc() = "Rows of the common tasks, written by one call a tick.";
  nb::class_<Assembly>(module, "Assembly")
      .def(nb::init<>())
      .def("point", &Assembly::point, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "position"_a,
           "rotation"_a, "twists"_a, "columns"_a, "axes"_a, "offset"_a)
      .def("pose", &Assembly::pose, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "position"_a,
           "rotation"_a, "twists"_a, "columns"_a)
      .def("rotation", &Assembly::rotation, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "position"_a,
           "rotation"_a, "twists"_a, "columns"_a)
      .def("angles", &Assembly::angles, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "position"_a,
           "rotation"_a, "twists"_a, "columns"_a, "picked"_a, "gimbal"_a)
      .def("com", &Assembly::com, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "com"_a, "jacobian"_a,
           "axes"_a)
      .def("joints", &Assembly::joints, nb::kw_only(), "J"_a, "error"_a, "reference"_a, "weight"_a, "positions"_a)
      .def("box", &Assembly::box, nb::kw_only(), "lower"_a, "upper"_a, "positions"_a, "columns"_a, "low"_a, "high"_a,
           "speed"_a, "acceleration"_a, "return_velocity"_a, "dt"_a, "order"_a)
      .def("run", &Assembly::run, "q"_a, "v"_a);
}
