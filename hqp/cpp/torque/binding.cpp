// Python's view of the elimination of constraint forces and of gravity compensation.
#include <cstdlib>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

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

// -1: the inertia is not positive definite; 0: the constraints are dependent; 1: all is written.
int eliminate(hqp::Elimination& e, const Columns& A, const Vector& bias, const Block& J, const Vector& gamma,
              double tolerance, const Block& X, const Block& phi, const Block& Q, const Block& T, const Block& top) {
  if (!e.factor(A.data())) return -1;
  e.columns(bias.data(), X.data());
  if (!e.constraints(J.data(), gamma.data(), tolerance, Q.data(), T.data())) return 0;
  e.project(Q.data(), top.data(), X.data(), phi.data());
  e.motions(X.data());
  return 1;
}

}  // namespace

NB_MODULE(_torque, module) {
  module.doc() = "The constraint forces eliminated, and gravity compensation.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::class_<hqp::Elimination>(module, "Elimination")
      .def(nb::init<Ints, Ints, int>(), "parents"_a, "actuated"_a, "rows"_a)
      .def("eliminate", &eliminate, "A"_a.noconvert(), "bias"_a.noconvert(), "J"_a.noconvert(), "gamma"_a.noconvert(),
           "tolerance"_a, "X"_a.noconvert(), "phi"_a.noconvert(), "Q"_a.noconvert(), "T"_a.noconvert(),
           "top"_a.noconvert());
  nb::class_<hqp::Holding>(module, "Holding")
      .def(nb::init<Ints, Ints>(), "actuated"_a, "others"_a)
      .def(
          "torque",
          [](hqp::Holding& h, const Block& J, const Vector& g, const Written& tau) {
            return h.torque(J.data(), g.data(), tau.data());
          },
          "J"_a.noconvert(), "g"_a.noconvert(), "tau"_a.noconvert());
}
