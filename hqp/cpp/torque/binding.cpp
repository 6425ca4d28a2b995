// Python's view of the elimination of constraint forces and of gravity compensation.
#include <cstdlib>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "../shared/isa.hpp"
#include "elimination.hpp"
#include "holding.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Ints = std::vector<int>;

[[noreturn]] void refuse(const char* text) { throw nb::value_error(text); }

class Elimination {
 public:
  Elimination(const Ints& parents, const Ints& actuated, int rows)
      : native_(HQP_FOR_MACHINE(make_elimination, parents, actuated, rows)) {}

  int eliminate(const Columns& A, const Vector& bias, const Block& J, const Vector& gamma, double tolerance,
                const Block& map, const Block& phi, const Block& Q, const Block& T, const Block& top) {
    return native_->eliminate(A.data(), bias.data(), J.data(), gamma.data(), tolerance, map.data(), phi.data(),
                              Q.data(), T.data(), top.data());
  }

 private:
  std::unique_ptr<hqp::Elimination> native_;
};

// Bound to arrays that are refilled in place, which it keeps alive.
class TorqueRows {
 public:
  explicit TorqueRows(const Block& map) : nv_(map.shape(0)), n_(map.shape(1) - 1) {
    native_.reset(HQP_FOR_MACHINE(make_torque_rows, map.data(), static_cast<int>(map.shape(0)), static_cast<int>(n_)));
    kept_.append(map);
  }

  void product(const Block& J, const Block& A, const Vector& asked_lower, const Vector& asked_upper,
               const Written& lower, const Written& upper) {
    if (J.shape(0) != A.shape(0) || J.shape(1) != nv_) refuse("J: wrong shape");
    native_->product(J.data(), asked(A, asked_lower, asked_upper, lower, upper));
    kept_.append(J);
  }

  void pick(Ints index, std::vector<double> weight, const Block& A, const Vector& asked_lower,
            const Vector& asked_upper, const Written& lower, const Written& upper) {
    if (index.size() != A.shape(0) || (!weight.empty() && weight.size() != index.size())) refuse("index: wrong shape");
    for (const int i : index)
      if (i < 0 || std::size_t(i) >= nv_) refuse("a coordinate beyond nv");
    native_->pick(std::move(index), std::move(weight), asked(A, asked_lower, asked_upper, lower, upper));
  }

  void motion(std::vector<double> scale, double rest, const Block& F, const Written& f) {
    if (scale.size() != nv_ || F.shape(0) != nv_ || F.shape(1) != n_ || f.shape(0) != nv_) refuse("F: wrong shape");
    native_->motion(std::move(scale), rest, F.data(), f.data());
    kept_.append(F);
    kept_.append(f);
  }

  void run(const Vector& v, const std::optional<Vector>& c) {
    if (v.shape(0) != nv_ || (c && c->shape(0) != nv_)) refuse("v or c: wrong shape");
    native_->run(v.data(), c ? c->data() : nullptr);
  }

 private:
  hqp::Asked asked(const Block& A, const Vector& asked_lower, const Vector& asked_upper, const Written& lower,
                   const Written& upper) {
    const std::size_t m = A.shape(0);
    if (A.shape(1) != n_ || asked_lower.shape(0) != m || asked_upper.shape(0) != m || lower.shape(0) != m ||
        upper.shape(0) != m)
      refuse("rows: wrong shape");
    kept_.append(nb::make_tuple(A, asked_lower, asked_upper, lower, upper));
    return {static_cast<int>(m), A.data(), asked_lower.data(), asked_upper.data(), lower.data(), upper.data()};
  }

  std::size_t nv_, n_;
  std::unique_ptr<hqp::TorqueRows> native_;
  nb::list kept_;
};

}  // namespace

NB_MODULE(_torque, module) {
  module.doc() = "The constraint forces eliminated, and gravity compensation.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::class_<Elimination>(module, "Elimination")
      .def(nb::init<const Ints&, const Ints&, int>(), "parents"_a, "actuated"_a, "rows"_a)
      .def("eliminate", &Elimination::eliminate, "A"_a.noconvert(), "bias"_a.noconvert(), "J"_a.noconvert(),
           "gamma"_a.noconvert(), "tolerance"_a, "map"_a.noconvert(), "phi"_a.noconvert(), "Q"_a.noconvert(),
           "T"_a.noconvert(), "top"_a.noconvert());
  nb::class_<TorqueRows>(module, "TorqueRows")
      .def(nb::init<const Block&>(), "map"_a.noconvert())
      .def("product", &TorqueRows::product, "J"_a.noconvert(), "A"_a.noconvert(), "asked_lower"_a.noconvert(),
           "asked_upper"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert())
      .def("pick", &TorqueRows::pick, "index"_a, "weight"_a, "A"_a.noconvert(), "asked_lower"_a.noconvert(),
           "asked_upper"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert())
      .def("motion", &TorqueRows::motion, "scale"_a, "rest"_a, "F"_a.noconvert(), "f"_a.noconvert())
      .def("run", &TorqueRows::run, "v"_a, "c"_a.none());
  nb::class_<hqp::Holding>(module, "Holding")
      .def(nb::init<Ints, Ints, int>(), "actuated"_a, "others"_a, "constraints"_a)
      .def(
          "torque",
          [](hqp::Holding& h, const Block& J, const Vector& g, const Written& tau) {
            return h.torque(J.data(), g.data(), tau.data());
          },
          "J"_a.noconvert(), "g"_a.noconvert(), "tau"_a.noconvert());
}
