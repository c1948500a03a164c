// What the files of the Python module `cdrj_ros._core` share: NumPy's arrays of numbers as arguments and results of
// functions, states and robots.
//
// Arrays go through NumPy's own interface: an argument takes a tenth of the time that it takes as a
// `nanobind::ndarray`, and may be a list.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/typing.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL cdrj_numpy
#define NO_IMPORT_ARRAY
#include <numpy/arrayobject.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "records.hpp"
#include "robot.hpp"

namespace cdrj {

namespace nb = nanobind;
using namespace nb::literals;

using Shape = std::initializer_list<Index>;

/// Load NumPy; before any array.
void use_numpy();

/// An array of numbers, contiguous by rows; as an argument that is not written, also what becomes one
/// without loss.
template <typename T>
class Array {
public:
    Array() = default;

    /// A new array.
    explicit Array(Shape shape) : object_(held(PyArray_SimpleNew(shape.size(), shape.begin(), CODE))) {}

    /// An array of numbers that `owner` keeps.
    Array(Shape shape, T* data, nb::handle owner)
        : object_(held(PyArray_SimpleNewFromData(shape.size(), shape.begin(), CODE, data))) {
        if (PyArray_SetBaseObject(array(), owner.inc_ref().ptr()) < 0) nb::raise_python_error();
    }

    /// Take an argument; false where it does not fit, and is not to be converted.
    bool take(nb::handle given, bool convert) noexcept {
        if (PyArray_Check(given.ptr())) {
            object_ = nb::borrow(given);
            if (PyArray_TYPE(array()) == CODE && PyArray_CHKFLAGS(array(), LAYOUT) &&
                PyArray_ISNOTSWAPPED(array())) {
                return true;
            }
        }
        if (!convert || !std::is_const_v<T>) return false;
        object_ = nb::steal(PyArray_FROMANY(given.ptr(), CODE, 0, 0, LAYOUT));
        if (!object_.is_valid()) PyErr_Clear();
        return object_.is_valid();
    }

    T* data() const { return static_cast<T*>(PyArray_DATA(array())); }
    Index size() const { return PyArray_SIZE(array()); }
    Index ndim() const { return PyArray_NDIM(array()); }
    Index shape(Index axis) const {
        if (axis >= ndim()) throw nb::value_error("an array has too few axes");
        return PyArray_DIM(array(), static_cast<int>(axis));
    }
    bool has(Shape shape) const {
        return std::equal(
            shape.begin(), shape.end(), PyArray_DIMS(array()), PyArray_DIMS(array()) + ndim());
    }
    const nb::object& object() const { return object_; }

private:
    using Number = std::remove_const_t<T>;
    static constexpr int CODE = std::is_same_v<Number, double> ? NPY_DOUBLE
                                : std::is_same_v<Number, bool> ? NPY_BOOL
                                                               : NPY_INT64;
    static constexpr int LAYOUT = std::is_const_v<T> ? NPY_ARRAY_CARRAY_RO : NPY_ARRAY_CARRAY;

    static nb::object held(PyObject* made) {
        if (made == nullptr) nb::raise_python_error();
        return nb::steal(made);
    }

    PyArrayObject* array() const { return reinterpret_cast<PyArrayObject*>(object_.ptr()); }

    nb::object object_;
};

/// Numbers that are only read, and numbers that are written.
using Given = Array<const double>;
using GivenIntegers = Array<const Index>;
using GivenFlags = Array<const bool>;
using Written = Array<double>;

template <typename T>
std::span<T> span_of(const Array<T>& array) {
    return {array.data(), static_cast<std::size_t>(array.size())};
}

/// Row `k` of a table.
template <typename T>
std::span<T> row_of(const Array<T>& table, Index k) {
    const Index width = table.shape(1);
    return {table.data() + k * width, static_cast<std::size_t>(width)};
}

/// A new array with these numbers.
template <typename Numbers, typename T = typename Numbers::value_type>
Array<T> copy_of(const Numbers& numbers, Shape shape) {
    Array<T> array(shape);
    std::ranges::copy(numbers, array.data());
    return array;
}

template <typename Numbers>
auto copy_of(const Numbers& numbers) {
    return copy_of(numbers, {static_cast<Index>(numbers.size())});
}

}  // namespace cdrj

/// How nanobind takes and gives arrays.
template <typename T>
struct nanobind::detail::type_caster<cdrj::Array<T>> {
    static constexpr auto NUMBER = const_name<std::is_same_v<std::remove_const_t<T>, double>>(
        const_name("float64"), const_name<std::is_same_v<std::remove_const_t<T>, bool>>("bool_", "int64"));
    NB_TYPE_CASTER(
        cdrj::Array<T>, const_name("numpy.typing.NDArray[numpy.") + NUMBER + const_name("]"))

    bool from_python(handle given, std::uint32_t flags, cleanup_list*) noexcept {
        return value.take(given, flags & static_cast<std::uint32_t>(cast_flags::convert));
    }

    static handle from_cpp(const cdrj::Array<T>& array, rv_policy, cleanup_list*) noexcept {
        return array.object().inc_ref();
    }
};

namespace cdrj {

/// Containers of Python with the types of what they hold.
template <typename T>
using List = nb::typed<nb::list, T>;
template <typename T>
using ByName = nb::typed<nb::dict, nb::str, T>;
using AnyTuple = nb::typed<nb::tuple, nb::any, nb::ellipsis>;

/// Samples between two looks at Ctrl-C.
inline constexpr Index PIECE = 4096;

/// Call `each` with 0, 1, ... until it returns false, without the interpreter's lock; returns how often it
/// returned true. Ctrl-C ends this between two pieces.
template <typename Each>
Index for_samples(Index samples, Each each, Index piece = PIECE) {
    for (Index k = 0; k < samples;) {
        if (PyErr_CheckSignals() != 0) nb::raise_python_error();
        const nb::gil_scoped_release free;
        for (const Index end = std::min(k + piece, samples); k < end; ++k) {
            if (!each(k)) return k;
        }
    }
    return samples;
}

/// Refuse arguments that do not fit.
inline void require(bool fits, const char* otherwise) {
    if (!fits) throw nb::value_error(otherwise);
}

/// State of a robot after a sample; Python does not see its parts.
struct HeldState {
    Nanoseconds stamp_ns;
    std::vector<double> numbers;

    /// Time from this state to a sample [s]; 0 before the first one.
    double seconds_until(Nanoseconds sample_ns) const {
        return stamp_ns == NEVER_NS ? 0.0 : static_cast<double>(sample_ns - stamp_ns) * 1e-9;
    }
};

/// A robot whose arrays stay alive with it, and the memory in which it computes a sample.
struct HeldRobot {
    HeldRobot(GivenIntegers topology, Given constants)
        : topology(std::move(topology)),
          constants(std::move(constants)),
          robot(this->topology.data(), this->constants.data()),
          out(robot.out_size()) {
        require(this->topology.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "topology is too short");
    }

    /// The state in `out`.
    std::vector<double> state() const { return {out.begin(), out.begin() + robot.state_size()}; }

    /// The estimate in `out`.
    Written estimate() const {
        return copy_of(std::span(out).subspan(robot.state_size(), robot.estimate_size()));
    }

    /// Angles of all motors and of all joints in one sample.
    void require_angles(Index motors, Index joints) const {
        require(
            motors == robot.topology.sizes.motors && joints == robot.topology.sizes.joints,
            "the angles are not those of this robot");
    }

    /// A state of such a robot.
    void require_state(const HeldState& state) const {
        require(
            state.numbers.size() == robot.state_size(), "state has not the size of this robot's");
    }

    GivenIntegers topology;
    Given constants;
    Robot robot;
    std::vector<double> out;  // of `Robot::advance`
};

/// Kinds as an enumeration, by their names in the order of their codes.
template <typename Kind, std::size_t n>
void bind_kinds(nb::module_& core, const char* name, const char* const (&names)[n], const char* doc) {
    nb::enum_<Kind> kinds(core, name, doc);
    for (std::size_t k = 0; k < n; ++k) kinds.value(names[k], static_cast<Kind>(k));
}

void bind_laws(nb::module_& core);
void bind_messages(nb::module_& core);
void bind_conditioning(nb::module_& core);
void bind_beliefs(nb::module_& core);
void bind_ensemble(nb::module_& core);
void bind_encoderless(nb::module_& core);
void bind_simulation(nb::module_& core);

}  // namespace cdrj
