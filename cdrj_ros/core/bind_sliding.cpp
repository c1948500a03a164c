// Friction along recorded motions, as `cdrj_ros.identification.friction_chain` uses it.
#include <pybind11/numpy.h>

#include "arrays.hpp"
#include "bind.hpp"
#include "sliding.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace cdrj {
namespace {

/// Constants of pulleys, one a row of the array.
std::span<const PulleyConstants> pulleys_of(const Matrix& rows) {
    require(
        rows.ndim() == 2 && rows.shape(1) == Index{sizeof(PulleyConstants) / 8},
        "pulleys has not the shape of its record");
    return {
        reinterpret_cast<const PulleyConstants*>(rows.data()), std::size_t(rows.shape(0))};
}

void require_table(const Given& table, py::ssize_t samples, std::size_t pulleys) {
    require(
        table.ndim() == 2 && table.shape(0) == samples && table.shape(1) == py::ssize_t(pulleys),
        "the tables differ in their numbers of samples or pulleys");
}

/// (43): kinetic and static loss of every pulley at every sample.
py::tuple pulley_losses(const Given& wrap, const Matrix& pulleys, Stribeck stribeck) {
    const auto rows = pulleys_of(pulleys);
    require(wrap.ndim() == 2, "wrap needs two axes");
    const py::ssize_t samples = wrap.shape(0);
    require_table(wrap, samples, rows.size());
    Matrix kinetic({samples, py::ssize_t(rows.size())}), fading({samples, py::ssize_t(rows.size())});
    for_samples(samples, [&](py::ssize_t k) {
        for (std::size_t p = 0; p < rows.size(); ++p) {
            const PulleyConstants& one = rows[p];
            const Loss loss = blended_loss(
                one.rho, one.mu_c, one.mu_s, *wrap.data(k, p), one.bearing_ratio,
                stribeck);
            *kinetic.mutable_data(k, p) = loss.kinetic;
            *fading.mutable_data(k, p) = loss.fading;
        }
        return true;
    });
    return py::make_tuple(kinetic, fading);
}

Matrix lagging_losses(
    const Given& slip, const Given& dt, const Given& kinetic, const Given& fading,
    const Matrix& pulleys) {
    const auto rows = pulleys_of(pulleys);
    const py::ssize_t samples = dt.size();
    for (const Given* table : {&slip, &kinetic, &fading}) require_table(*table, samples, rows.size());
    Matrix loss({samples, py::ssize_t(rows.size())});
    for (std::size_t p = 0; p < rows.size(); ++p) {
        LaggingLoss one{rows[p]};
        for_samples(samples, [&](py::ssize_t k) {
            // the speed of this sample acts on the next one
            const Loss now{*kinetic.data(k, p), *fading.data(k, p)};
            const double moved = k > 0 ? *slip.data(k, p) - *slip.data(k - 1, p) : 0.0;
            *loss.mutable_data(k, p) = one.next(now, moved, k > 0 ? dt.data()[k] : 0.0);
            return true;
        });
    }
    return loss;
}

py::tuple shares_of_bound(
    const Given& slip, const Given& loss, const Given& pull, const Given& arc, const Given& hidden,
    const Matrix& pulleys) {
    const auto rows = pulleys_of(pulleys);
    require(slip.ndim() == 2, "slip needs two axes");
    const py::ssize_t samples = slip.shape(0);
    for (const Given* table : {&slip, &loss, &pull, &arc, &hidden}) {
        require_table(*table, samples, rows.size());
    }
    Matrix low({samples, py::ssize_t(rows.size())}), high({samples, py::ssize_t(rows.size())});
    for (std::size_t p = 0; p < rows.size(); ++p) {
        ShareOfBound one{rows[p]};
        for_samples(samples, [&](py::ssize_t k) {
            const double moved = k > 0 ? *slip.data(k, p) - *slip.data(k - 1, p) : 0.0;
            one.next(
                moved, *loss.data(k, p), *pull.data(k, p), *arc.data(k, p), *hidden.data(k, p));
            *low.mutable_data(k, p) = one.least;
            *high.mutable_data(k, p) = one.most;
            return true;
        });
    }
    return py::make_tuple(low, high);
}

}  // namespace

void bind_sliding(py::module_& core) {
    core.def("pulley_losses", pulley_losses, "wrap"_a, "pulleys"_a.noconvert(), "stribeck"_a);
    core.def(
        "lagging_losses", lagging_losses, "slip"_a, "dt"_a, "kinetic"_a, "static"_a,
        "pulleys"_a.noconvert());
    core.def(
        "shares_of_bound", shares_of_bound, "slip"_a, "loss"_a, "pull"_a, "arc"_a, "hidden"_a,
        "pulleys"_a.noconvert());
}

}  // namespace cdrj
