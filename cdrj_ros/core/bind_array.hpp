// NumPy's arrays of numbers as arguments and results of functions that Python calls.
//
// They go through NumPy's own interface: an argument takes a tenth of the time that it takes as a
// `nanobind::ndarray`, and may be a list.
#pragma once

#include <nanobind/nanobind.h>

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

#include "robot_records.hpp"

namespace cdrj {

namespace nb = nanobind;

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
    NB_TYPE_CASTER(cdrj::Array<T>, const_name("numpy.ndarray"))

    bool from_python(handle given, std::uint32_t flags, cleanup_list*) noexcept {
        return value.take(given, flags & static_cast<std::uint32_t>(cast_flags::convert));
    }

    static handle from_cpp(const cdrj::Array<T>& array, rv_policy, cleanup_list*) noexcept {
        return array.object().inc_ref();
    }
};
