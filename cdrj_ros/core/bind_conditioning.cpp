// Conditioning of readings, as `cdrj_ros.estimation` uses it.
#include <memory>
#include <string>
#include <tuple>
#include <utility>

#include "bind.hpp"
#include "conditioner.hpp"
#include "recording.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Stamps = py::array_t<Nanoseconds, py::array::c_style | py::array::forcecast>;

/// An array that owns the memory of a vector.
template <typename T>
py::array_t<T> array_of(std::vector<T>&& values, std::vector<py::ssize_t> shape) {
    auto owned = std::make_unique<std::vector<T>>(std::move(values));
    T* data = owned->data();
    py::capsule owner(owned.release(), [](void* memory) {
        delete static_cast<std::vector<T>*>(memory);
    });
    return py::array_t<T>(std::move(shape), data, owner);
}

std::vector<Conditioner::Target> targets_of(
    const Conditioner& conditioner, Topic topic, const py::sequence& names) {
    std::vector<Conditioner::Target> targets;
    targets.reserve(names.size());
    for (const py::handle name : names) {
        py::ssize_t size = 0;
        const char* text = PyUnicode_AsUTF8AndSize(name.ptr(), &size);
        if (text == nullptr) {  // not text, or text that no message can hold
            PyErr_Clear();
            targets.push_back(Conditioner::UNKNOWN);
        } else {
            targets.push_back(conditioner.find(topic, {text, static_cast<std::size_t>(size)}));
        }
    }
    return targets;
}

std::vector<double> numbers_of(const py::sequence& positions) {
    if (Numbers::check_(positions)) {
        const auto numbers = span_of(py::reinterpret_borrow<Numbers>(positions));
        return {numbers.begin(), numbers.end()};
    }
    std::vector<double> numbers;
    numbers.reserve(positions.size());
    for (const py::handle position : positions) numbers.push_back(position.cast<double>());
    return numbers;
}

/// `unseen` of every sample without deviations, and `offset` of those with the ones of the sample
/// before: always the same object, to be recognised by.
const py::object& no_deviations() {
    static const auto* const empty = new py::object(py::array_t<double>(std::vector<py::ssize_t>{0, 0}));
    return *empty;
}

py::tuple tuple_of(const Sample& sample, std::size_t motors) {
    const auto angles = std::span(sample.angle);
    py::object unseen = no_deviations(), offset = no_deviations();
    if (!sample.unseen.empty()) unseen = copy_of(sample.unseen).reshape({2, -1});
    if (!sample.offset.empty()) offset = copy_of(sample.offset).reshape({3, -1});
    return py::make_tuple(
        sample.stamp_ns,
        copy_of(angles.first(motors)),
        copy_of(angles.subspan(motors)),
        unseen,
        offset,
        sample.doubtful,
        sample.predicted,
        sample.silent);
}

py::list list_of(const std::vector<Sample>& samples, std::size_t motors) {
    py::list found;
    for (const Sample& sample : samples) found.append(tuple_of(sample, motors));
    return found;
}

py::list feed(
    Conditioner& conditioner,
    Topic topic,
    Nanoseconds stamp_ns,
    const py::sequence& names,
    const py::sequence& positions) {
    const auto samples = conditioner.take(
        stamp_ns, targets_of(conditioner, topic, names), numbers_of(positions));
    return list_of(samples, conditioner.motors());
}

py::list feed_message(Conditioner& conditioner, Topic topic, const JointStateDecoder& decoder) {
    return list_of(conditioner.take(topic, decoder.last()), conditioner.motors());
}

py::dict refused(const Conditioner& conditioner) {
    py::dict counts;
    for (std::size_t cause = 0; cause < CAUSES; ++cause) {
        counts[py::str(CAUSE_NAMES[cause].data(), CAUSE_NAMES[cause].size())] =
            conditioner.refused()[cause];
    }
    return counts;
}

void refuse(Conditioner& conditioner, std::string_view name) {
    for (std::size_t cause = 0; cause < CAUSES; ++cause) {
        if (CAUSE_NAMES[cause] == name) return conditioner.refuse(static_cast<Cause>(cause));
    }
    throw py::key_error(std::string(name));
}

/// A value of every channel, by name, where `get` gives one.
template <typename Get>
auto by_name(const Conditioner& conditioner, Get get) {
    py::dict found;
    for (std::size_t k = 0; k < conditioner.axes().size(); ++k) {
        const py::object value = get(conditioner.channels()[k]);
        if (!value.is_none()) found[py::str(conditioner.axes()[k].name)] = value;
    }
    return found;
}

constexpr py::ssize_t REMEMBERED = 8;  // numbers of every axis

py::tuple memory(const Conditioner& conditioner) {
    std::vector<double> rows, stepped;
    for (const Conditioner::Memory& one : conditioner.memory()) {
        rows.insert(
            rows.end(),
            {one.speed, one.acceleration, one.fastest, one.travelled, one.windows,
             one.steps.bend, one.steps.unexplained, one.steps.displaced});
        stepped.push_back(one.steps.stepped ? 1.0 : 0.0);
    }
    const auto axes = static_cast<py::ssize_t>(stepped.size());
    return py::make_tuple(
        array_of(std::move(rows), {axes, REMEMBERED}), array_of(std::move(stepped), {axes}));
}

void recall(Conditioner& conditioner, const Numbers& rows, const Numbers& stepped) {
    const auto axes = static_cast<py::ssize_t>(conditioner.axes().size());
    if (rows.ndim() != 2 || rows.shape(0) != axes || rows.shape(1) != REMEMBERED ||
        stepped.size() != axes) {
        throw py::value_error("memory of another number of axes");
    }
    std::vector<Conditioner::Memory> memory;
    for (py::ssize_t k = 0; k < axes; ++k) {
        const double* row = rows.data(k, 0);
        memory.push_back(
            {row[0], row[1], row[2], row[3], row[4],
             {row[5], row[6], row[7], stepped.data()[k] != 0.0}});
    }
    conditioner.recall(memory);
}

void expect(Conditioner& conditioner, const Numbers& angles, Nanoseconds stamp_ns) {
    if (static_cast<std::size_t>(angles.size()) != conditioner.axes().size()) {
        throw py::value_error("one angle per axis is needed");
    }
    conditioner.expect(span_of(angles), stamp_ns);
}

py::tuple tuple_of(Samples&& samples, std::size_t motors, std::size_t joints) {
    const auto n = static_cast<py::ssize_t>(samples.stamp_ns.size());
    const auto m = static_cast<py::ssize_t>(motors), j = static_cast<py::ssize_t>(joints);
    const auto unseen = static_cast<py::ssize_t>(samples.unseen_rows.size());
    const auto doubtful = static_cast<py::ssize_t>(samples.doubtful.size());
    const auto changes = static_cast<py::ssize_t>(samples.offset_rows.size());
    return py::make_tuple(
        samples.after_jump,
        array_of(std::move(samples.stamp_ns), {n}),
        array_of(std::move(samples.motor), {n, m}),
        array_of(std::move(samples.joint), {n, j}),
        array_of(std::move(samples.unseen_rows), {unseen}),
        array_of(std::move(samples.unseen), {unseen, 2, m + j}),
        array_of(std::move(samples.offset_rows), {changes}),
        array_of(std::move(samples.offset), {changes, 3, m + j}),
        array_of(std::move(samples.doubtful), {doubtful}));
}

/// A recording, with the arrays that it reads and the conditioner that takes it.
class HeldRecording {
public:
    using Given = std::tuple<Topic, std::string, Stamps, Stamps, Numbers>;

    HeldRecording(py::object conditioner, std::vector<Given> given)
        : held_(std::move(conditioner)),
          given_(std::move(given)),
          conditioner_(held_.cast<Conditioner&>()),
          recording_(conditioner_, series()) {}

    bool is_over() const { return recording_.is_over(); }

    py::list advance(std::size_t most) {
        std::vector<Samples> pieces;
        {
            const py::gil_scoped_release others_may_run;
            pieces = recording_.advance(most);
        }
        const std::size_t motors = conditioner_.motors();
        py::list found;
        for (Samples& piece : pieces) {
            found.append(tuple_of(std::move(piece), motors, conditioner_.axes().size() - motors));
        }
        return found;
    }

private:
    std::vector<Series> series() const {
        std::vector<Series> found;
        for (const auto& [topic, name, stamp_ns, arrival_ns, value] : given_) {
            if (stamp_ns.size() != value.size() || arrival_ns.size() != value.size()) {
                throw py::value_error("a series needs as many stamps and arrivals as values");
            }
            found.push_back(
                {conditioner_.find(topic, name), span_of(stamp_ns),
                 span_of(arrival_ns), span_of(value)});
        }
        return found;
    }

    py::object held_;
    std::vector<Given> given_;
    Conditioner& conditioner_;
    Recording recording_;
};

py::array_t<double> angles_of_array(const Axis& axis, const Numbers& readings) {
    std::vector<double> angles = angles_of(axis, span_of(readings));
    const auto n = static_cast<py::ssize_t>(angles.size());
    return array_of(std::move(angles), {n});
}

void bind_axis(py::module_& core) {
    py::class_<Axis>(core, "Axis")
        .def(
            py::init([](std::string name, double lower, double upper, double max_speed,
                        Nanoseconds clock_offset_ns, double period, double scale, double offset,
                        std::vector<double> corrected_at, std::vector<double> correction,
                        double bandwidth, bool adaptive, double band, double negligible,
                        double worth, double start) {
                if (corrected_at.size() != correction.size()) {
                    throw py::value_error("a correction needs as many values as angles");
                }
                return Axis{std::move(name), lower, upper, max_speed, clock_offset_ns, period,
                            scale, offset, std::move(corrected_at), std::move(correction),
                            bandwidth, adaptive, band, negligible, worth, start};
            }),
            py::arg("name"), py::kw_only(), py::arg("lower"), py::arg("upper"),
            py::arg("max_speed"), py::arg("clock_offset_ns"), py::arg("period"), py::arg("scale"),
            py::arg("offset"), py::arg("corrected_at"), py::arg("correction"),
            py::arg("bandwidth"), py::arg("adaptive"), py::arg("band"), py::arg("negligible"),
            py::arg("worth"), py::arg("start"))
        .def_readonly("name", &Axis::name)
        .def_readonly("lower", &Axis::lower)
        .def_readonly("upper", &Axis::upper)
        .def_readonly("clock_offset_ns", &Axis::clock_offset_ns)
        .def_readonly("bandwidth", &Axis::bandwidth)
        .def_readonly("adaptive", &Axis::adaptive)
        .def("angles_of", &angles_of_array, py::arg("readings"))
        .def("angle_near", &angle_near, py::arg("reading"), py::arg("near"));
}

void bind_conditioner(py::module_& core) {
    const auto counter = [](auto member) {
        return [member](const Conditioner& conditioner) { return conditioner.*member; };
    };
    py::class_<Conditioner>(core, "Conditioner")
        .def(
            py::init<std::vector<Axis>, std::size_t, bool, Nanoseconds>(),
            py::arg("axes"), py::arg("motors"), py::arg("predict"), py::arg("horizon_ns"))
        .def("feed", &feed, py::arg("topic"), py::arg("stamp_ns"), py::arg("names"),
             py::arg("positions"))
        .def("feed_message", &feed_message, py::arg("topic"), py::arg("message"))
        .def("refuse", &refuse, py::arg("cause"))
        .def("reset", &Conditioner::reset, py::arg("keep_turns") = false)
        .def("remembered", &memory)
        .def("remember", &recall, py::arg("rows"), py::arg("stepped"))
        .def("continue_from", &expect, py::arg("angles"), py::arg("stamp_ns"))
        .def("use_tracking_of", &Conditioner::set_tracking, py::arg("axes"))
        .def_property_readonly("refused", &refused)
        .def_property_readonly("accepted", counter(&Conditioner::accepted))
        .def_property_readonly("elsewhere", counter(&Conditioner::elsewhere))
        .def_property_readonly("clock_jumps", counter(&Conditioner::clock_jumps))
        .def_property_readonly("gaps", counter(&Conditioner::gaps))
        .def_property_readonly("steps", counter(&Conditioner::steps))
        .def_property_readonly("crowded", [](const Conditioner& c) { return c.time_line().crowded; })
        .def_property_readonly("lag_ns", [](const Conditioner& c) { return c.time_line().lag_ns; })
        .def_property_readonly("unheard", [](const Conditioner& c) {
            return py::list(by_name(c, [](const Channel& channel) -> py::object {
                return channel.last_ns < 0 ? py::object(py::bool_(true)) : py::none();
            }));
        })
        .def_property_readonly("displaced", [](const Conditioner& c) {
            return by_name(c, [](const Channel& channel) -> py::object {
                const StepMemory& steps = channel.steps.memory;
                if (!steps.stepped && steps.displaced == 0.0) return py::none();
                return py::float_(steps.displaced);
            });
        })
        .def_property_readonly("alternating", [](const Conditioner& c) {
            return py::list(by_name(c, [](const Channel& channel) -> py::object {
                if (!channel.steps.alternates()) return py::none();
                return py::bool_(true);
            }));
        })
        .def_property_readonly("lagging", [](const Conditioner& c) {
            py::dict found;
            for (std::size_t k = 0; k < c.axes().size(); ++k) {
                const Channel& channel = c.channels()[k];
                if (!channel.lags(c.axes()[k])) continue;
                found[py::str(c.axes()[k].name)] =
                    py::make_tuple(channel.lag.lag_ns, channel.lag.growth);
            }
            return found;
        })
        .def_property_readonly("held", [](const Conditioner& c) {
            std::size_t held = 0;
            for (const Channel& channel : c.channels()) {
                held += channel.held.size() + (channel.off ? 1 : 0);
            }
            return held;
        })
        .def_property_readonly("held_of", [](const Conditioner& c) {
            return by_name(c, [](const Channel& channel) -> py::object {
                py::list held;
                for (const Raw& raw : channel.held) {
                    held.append(py::make_tuple(raw.stamp_ns, raw.reading));
                }
                return held;
            });
        })
        .def_property_readonly("waiting", [](const Conditioner& c) {
            return by_name(c, [](const Channel& channel) -> py::object {
                return py::int_(channel.readings.size() + channel.recent.size());
            });
        });
}

}  // namespace

void bind_conditioning(py::module_& core) {
    core.attr("ALL_SEEN") = no_deviations();
    core.attr("NONE_CHANGED") = no_deviations();
    core.attr("MAX_GAP_NS") = MAX_GAP_NS;
    core.attr("CONFIRMATIONS") = CONFIRMATIONS;
    core.attr("RANGE_MARGIN") = RANGE_MARGIN;
    core.attr("LARGEST") = LARGEST;
    core.attr("WAITING") = WAITING;
    py::enum_<Topic>(core, "Topic")
        .value("MOTORS", Topic::motors)
        .value("JOINTS", Topic::joints)
        .value("BOTH", Topic::both);
    bind_axis(core);
    bind_conditioner(core);
    py::class_<HeldRecording>(core, "Recording")
        .def(
            py::init<py::object, std::vector<HeldRecording::Given>>(), py::arg("conditioner"),
            py::arg("series"))
        .def_property_readonly("is_over", &HeldRecording::is_over)
        .def("advance", &HeldRecording::advance, py::arg("most"));
    py::class_<TrackingFilter>(core, "TrackingFilter")
        .def(py::init<>())
        .def("track", &TrackingFilter::track, py::arg("since_ns"), py::arg("reading"), py::arg("bandwidth"),
             py::arg("band"), py::arg("adaptive"))
        .def_property_readonly("moves", &TrackingFilter::moves);
}

}  // namespace cdrj
