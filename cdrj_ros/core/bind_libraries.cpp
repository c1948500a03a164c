// nanobind's own functions, which it gives as source, and the place of NumPy's.
#include <nb_combined.cpp>

#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL cdrj_numpy
#include <numpy/arrayobject.h>

namespace cdrj {

void use_numpy() {
    if (_import_array() < 0) nanobind::raise_python_error();
}

}  // namespace cdrj
