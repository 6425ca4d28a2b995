// Python's view of the elimination of constraint forces and of gravity compensation.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "../common/capsule.hpp"
#include "../common/isa.hpp"
#include "chain.hpp"
#include "elimination.hpp"
#include "holding.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using WrittenColumns = nb::ndarray<double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Marks = nb::ndarray<const std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Ints = std::vector<int>;

[[noreturn]] void refuse(const char* text) { throw nb::value_error(text); }

class Elimination {
 public:
  Elimination(const Ints& parents, const Ints& actuated, const Marks& out)
      : native_(HQP_FOR_MACHINE(make_elimination, parents, actuated, static_cast<int>(out.size()), out.data())),
        out_(nb::cast(out)) {}

  int eliminate(const Columns& A, const Vector& bias, const Block& J, const Vector& gamma, double tolerance,
                const Block& map, const Block& phi, const Block& Q, const Block& T, const Block& top) {
    return native_->eliminate(A.data(), bias.data(), J.data(), gamma.data(), tolerance, map.data(), phi.data(),
                              Q.data(), T.data(), top.data());
  }
  nb::capsule reactions() { return hqp::capsule_of(native_.get()); }
  hqp::Elimination& get() { return *native_; }

 private:
  std::unique_ptr<hqp::Elimination> native_;
  nb::object out_;
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
  hqp::TorqueRows& get() { return *native_; }

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

// Bound to arrays that are refilled in place, which it keeps alive.
class ForceRows {
 public:
  ForceRows(const Block& T, const Block& top) : m_(top.shape(0)), n_(top.shape(1) - 1), T_(T.data()), top_(top.data()) {
    if (T.shape(0) != m_ || T.shape(1) != m_) refuse("T: wrong shape");
    native_.reset(HQP_FOR_MACHINE(make_force_rows, static_cast<int>(m_), static_cast<int>(n_)));
    kept_.append(nb::make_tuple(T, top));
  }
  void turn(int first, const Columns& rotation) {
    if (first < 0 || std::size_t(first) + 3 > m_ || rotation.size() != 9) refuse("first: wrong shape");
    native_->turn(first, rotation.data());
    kept_.append(rotation);
  }
  void add(const Block& C, const Block& A, const Vector& asked_lower, const Vector& asked_upper, const Written& lower,
           const Written& upper) {
    const std::size_t rows = C.shape(0);
    if (C.shape(1) != m_ || A.shape(0) != rows || A.shape(1) != n_ || asked_lower.shape(0) != rows ||
        asked_upper.shape(0) != rows || lower.shape(0) != rows || upper.shape(0) != rows)
      refuse("rows: wrong shape");
    native_->add(C.data(), {static_cast<int>(rows), A.data(), asked_lower.data(), asked_upper.data(), lower.data(),
                            upper.data()});
    kept_.append(nb::make_tuple(C, A, asked_lower, asked_upper, lower, upper));
  }
  void share(const Block& C, const Ints& first, const Columns& one, const Columns& other,
             const std::vector<double>& middles, const std::vector<double>& factors, double arm, const Vector& share) {
    if (C.shape(0) != 6 || C.shape(1) != m_ || first.size() != 2 || middles.size() != 4 || factors.size() != 2 ||
        one.size() != 9 || other.size() != 9 || share.size() != 1)
      refuse("contacts: wrong shape");
    for (const int at : first)
      if (at < 0 || std::size_t(at) + 6 > m_) refuse("first: wrong shape");
    native_->share({C.data(),
                    {first[0], first[1]},
                    {one.data(), other.data()},
                    {{middles[0], middles[1]}, {middles[2], middles[3]}},
                    {factors[0], factors[1]},
                    arm,
                    share.data()});
    kept_.append(nb::make_tuple(C, one, other, share));
  }
  void run(const std::optional<Vector>& shift) {
    if (shift && shift->shape(0) != n_) refuse("shift: wrong shape");
    native_->run(T_, top_, shift ? shift->data() : nullptr);
  }
  hqp::ForceRows& get() { return *native_; }

 private:
  std::size_t m_, n_;
  const double *T_, *top_;
  std::unique_ptr<hqp::ForceRows> native_;
  nb::list kept_;
};

// The chain over arrays of Python, for another native module.
class Chain {
 public:
  Chain(nb::object elimination, nb::object rows, nb::object forces, const Columns& A, const Vector& bias,
        const WrittenColumns& factor, const Block& J, const Vector& gamma, double tolerance, const Block& map,
        const Block& phi, const Block& Q, const Block& T, const Block& top, const nb::capsule& limits)
      : core_(nb::cast<Elimination&>(elimination).get(), nb::cast<TorqueRows&>(rows).get(),
              forces.is_none() ? nullptr : &nb::cast<ForceRows&>(forces).get(),
              {bias.shape(0), phi.shape(0), A.data(), bias.data(), J.data(), gamma.data(), tolerance, factor.data(),
               map.data(), phi.data(), Q.data(), T.data(), top.data()}) {
    const std::size_t nv = bias.shape(0), n = phi.shape(0), m = gamma.shape(0);
    if (A.size() != nv * nv || factor.size() != A.size() || J.size() != m * nv || map.size() != nv * (n + 1) ||
        Q.size() != nv * m || T.size() != m * m || top.size() != m * (n + 1))
      refuse("an array has a wrong shape");
    core_.limits(hqp::limits_of(limits));
    kept_ = nb::make_tuple(elimination, rows, forces, A, bias, factor, J, gamma, map, phi, Q, T, top, limits);
  }

  // next: of the solver, null where Python asks it.
  nb::capsule before(const std::optional<nb::capsule>& next) {
    core_.before(next ? hqp::call_of(*next) : nullptr);
    next_kept_ = next ? nb::object(*next) : nb::none();
    return hqp::capsule_of(&core_);
  }

 private:
  hqp::Chain core_;
  nb::object kept_, next_kept_;
};

}  // namespace

NB_MODULE(_torque, module) {
  module.doc() = "The constraint forces eliminated, and gravity compensation.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::class_<Elimination>(module, "Elimination")
      .def(nb::init<const Ints&, const Ints&, const Marks&>(), "parents"_a, "actuated"_a, "out"_a.noconvert())
      .def("eliminate", &Elimination::eliminate, "A"_a.noconvert(), "bias"_a.noconvert(), "J"_a.noconvert(),
           "gamma"_a.noconvert(), "tolerance"_a, "map"_a.noconvert(), "phi"_a.noconvert(), "Q"_a.noconvert(),
           "T"_a.noconvert(), "top"_a.noconvert())
      .def("reactions", &Elimination::reactions);
  nb::class_<TorqueRows>(module, "TorqueRows")
      .def(nb::init<const Block&>(), "map"_a.noconvert())
      .def("product", &TorqueRows::product, "J"_a.noconvert(), "A"_a.noconvert(), "asked_lower"_a.noconvert(),
           "asked_upper"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert())
      .def("pick", &TorqueRows::pick, "index"_a, "weight"_a, "A"_a.noconvert(), "asked_lower"_a.noconvert(),
           "asked_upper"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert())
      .def("motion", &TorqueRows::motion, "scale"_a, "rest"_a, "F"_a.noconvert(), "f"_a.noconvert())
      .def("run", &TorqueRows::run, "v"_a, "c"_a.none());
  nb::class_<ForceRows>(module, "ForceRows")
      .def(nb::init<const Block&, const Block&>(), "T"_a.noconvert(), "top"_a.noconvert())
      .def("turn", &ForceRows::turn, "first"_a, "rotation"_a.noconvert())
      .def("share", &ForceRows::share, "C"_a.noconvert(), "first"_a, "one"_a.noconvert(), "other"_a.noconvert(),
           "middles"_a, "factors"_a, "arm"_a, "share"_a.noconvert())
      .def("add", &ForceRows::add, "C"_a.noconvert(), "A"_a.noconvert(), "asked_lower"_a.noconvert(),
           "asked_upper"_a.noconvert(), "lower"_a.noconvert(), "upper"_a.noconvert())
      .def("run", &ForceRows::run, "shift"_a.none());
  nb::class_<Chain>(module, "Chain")
      .def(nb::init<nb::object, nb::object, nb::object, const Columns&, const Vector&, const WrittenColumns&,
                    const Block&, const Vector&, double, const Block&, const Block&, const Block&, const Block&,
                    const Block&, const nb::capsule&>(),
           "elimination"_a, "rows"_a, "forces"_a.none(), "A"_a.noconvert(), "bias"_a.noconvert(),
           "factor"_a.noconvert(), "J"_a.noconvert(), "gamma"_a.noconvert(), "tolerance"_a, "map"_a.noconvert(),
           "phi"_a.noconvert(), "Q"_a.noconvert(), "T"_a.noconvert(), "top"_a.noconvert(), "limits"_a)
      .def("before", &Chain::before, "next"_a.none());
  nb::class_<hqp::Holding>(module, "Holding")
      .def(nb::init<Ints, Ints, int>(), "actuated"_a, "others"_a, "constraints"_a)
      .def(
          "torque",
          [](hqp::Holding& h, const Block& J, const Vector& g, const Written& tau) {
            return h.torque(J.data(), g.data(), tau.data());
          },
          "J"_a.noconvert(), "g"_a.noconvert(), "tau"_a.noconvert());
}
