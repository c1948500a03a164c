// Conditioning of readings, as `cdrj_ros.estimation` uses it.
#include <string>
#include <tuple>
#include <utility>

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bind.hpp"
#include "conditioner.hpp"
#include "recording.hpp"

namespace cdrj {
namespace {

std::vector<Conditioner::Target> targets_of(
    const Conditioner& conditioner, Topic topic, const nb::typed<nb::sequence, nb::str>& names) {
    std::vector<Conditioner::Target> targets;
    targets.reserve(nb::len(names));
    for (const nb::handle name : names) {
        Py_ssize_t size = 0;
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

/// `unseen` of every sample without deviations, and `offset` of those with the ones of the sample
/// before: always the same object, to be recognised by.
const nb::object& no_deviations() {
    static const auto* const empty = new nb::object(Written({0, 0}).object());
    return *empty;
}

/// A table of so many rows; `no_deviations` where it is empty.
nb::object table_of(const std::vector<double>& numbers, Index rows) {
    if (numbers.empty()) return no_deviations();
    return copy_of(numbers, {rows, Index(numbers.size()) / rows}).object();
}

/// `doubtful` and `after_gap` of every sample where they are empty.
const nb::object& no_flags() {
    static const auto* const empty = new nb::object(Array<bool>({0}).object());
    return *empty;
}

nb::object flags_of(const std::vector<bool>& flags) {
    return flags.empty() ? no_flags() : copy_of(flags).object();
}

AnyTuple tuple_of(const Sample& sample, std::size_t motors) {
    const auto angles = std::span(sample.angle);
    return nb::make_tuple(
        sample.stamp_ns,
        copy_of(angles.first(motors)),
        copy_of(angles.subspan(motors)),
        table_of(sample.unseen, 2),
        table_of(sample.offset, 2),
        flags_of(sample.doubtful),
        flags_of(sample.after_gap),
        sample.predicted,
        sample.silent);
}

List<AnyTuple> list_of(const std::vector<Sample>& samples, std::size_t motors) {
    nb::list found;
    for (const Sample& sample : samples) found.append(tuple_of(sample, motors));
    return found;
}

List<AnyTuple> feed(
    Conditioner& conditioner, Topic topic, Nanoseconds stamp_ns, const nb::typed<nb::sequence, nb::str>& names,
    const Given& positions, Nanoseconds arrival_ns, bool by_arrival) {
    const auto samples = conditioner.take(
        stamp_ns, targets_of(conditioner, topic, names), span_of(positions), {arrival_ns, by_arrival});
    return list_of(samples, conditioner.motors());
}

List<AnyTuple> feed_message(Conditioner& conditioner, Topic topic, const JointStateDecoder& decoder) {
    return list_of(conditioner.take(topic, decoder.last()), conditioner.motors());
}

ByName<ByName<double>> take_refused(Conditioner& conditioner) {
    nb::dict found;
    const std::vector<Conditioner::Sizes> sizes = conditioner.take_refused();
    for (std::size_t k = 0; k < sizes.size(); ++k) {
        nb::dict of_axis;
        for (std::size_t c = 0; c < CAUSES; ++c) {
            if (!std::isnan(sizes[k][c])) of_axis[nb::str(CAUSE_NAMES[c].data())] = sizes[k][c];
        }
        if (of_axis.size() > 0) found[conditioner.axes()[k].name.c_str()] = of_axis;
    }
    return found;
}

ByName<int> refused(const Conditioner& conditioner) {
    nb::dict counts;
    for (std::size_t cause = 0; cause < CAUSES; ++cause) {
        counts[nb::str(CAUSE_NAMES[cause].data(), CAUSE_NAMES[cause].size())] =
            conditioner.refused()[cause];
    }
    return counts;
}

void refuse(Conditioner& conditioner, const std::string& name) {
    for (std::size_t cause = 0; cause < CAUSES; ++cause) {
        if (CAUSE_NAMES[cause] == name) return conditioner.refuse(static_cast<Cause>(cause));
    }
    throw nb::key_error(name.c_str());
}

/// A value of every channel, by name, where `get` gives one.
template <typename T, typename Get>
ByName<T> by_name(const Conditioner& conditioner, Get get) {
    nb::dict found;
    for (std::size_t k = 0; k < conditioner.axes().size(); ++k) {
        const nb::object value = get(conditioner.channels()[k]);
        if (!value.is_none()) found[conditioner.axes()[k].name.c_str()] = value;
    }
    return found;
}

template <typename Condition>
List<nb::str> names_where(const Conditioner& conditioner, Condition condition) {
    nb::list found;
    for (std::size_t k = 0; k < conditioner.axes().size(); ++k) {
        if (condition(conditioner.channels()[k])) found.append(conditioner.axes()[k].name);
    }
    return found;
}

std::pair<Written, Written> memory(Conditioner& conditioner) {
    const auto [numbers, stepped] = conditioner.memory();
    const auto axes = static_cast<Index>(stepped.size());
    return {copy_of(numbers, {axes, Channel::REMEMBERED}), copy_of(stepped)};
}

void recall(Conditioner& conditioner, const Given& rows, const Given& stepped) {
    const auto axes = static_cast<Index>(conditioner.axes().size());
    require(
        rows.has({axes, Channel::REMEMBERED}) && stepped.size() == axes,
        "memory of another number of axes");
    conditioner.recall(span_of(rows), span_of(stepped));
}

void expect(Conditioner& conditioner, const Given& angles, Nanoseconds stamp_ns) {
    require(angles.size() == Index(conditioner.axes().size()), "one angle per axis is needed");
    conditioner.expect(span_of(angles), stamp_ns);
}

/// Fields of `Samples`.
using Columns = nb::typed<
    nb::tuple, GivenIntegers, Given, Given, Given, GivenFlags, GivenFlags, GivenIntegers, Given>;

Columns tuple_of(const Samples& samples, Index motors, Index joints) {
    const auto n = static_cast<Index>(samples.stamp_ns.size());
    const bool seen = samples.unseen.empty();
    const auto flags = [&](const std::vector<bool>& rows) {
        return copy_of(rows, {rows.empty() ? 0 : n, motors + joints});
    };
    const auto changes = static_cast<Index>(samples.offset_rows.size());
    return nb::make_tuple(
        copy_of(samples.stamp_ns),
        copy_of(samples.motor, {n, motors}),
        copy_of(samples.joint, {n, joints}),
        seen ? copy_of(samples.unseen, {0, 0, 0}) : copy_of(samples.unseen, {n, 2, motors + joints}),
        flags(samples.doubtful),
        flags(samples.after_gap),
        copy_of(samples.offset_rows),
        copy_of(samples.offset, {changes, 2, motors + joints}));
}

/// Stamps, times of arrival and readings of a name on a topic, and whether stamps are those times.
using GivenSeries = std::tuple<Topic, std::string, GivenIntegers, GivenIntegers, Given, bool>;

/// `condition` of a whole recording, which signals may end.
List<Columns> condition_recording(Conditioner& conditioner, const std::vector<GivenSeries>& given) {
    std::vector<Series> series;
    for (const auto& [topic, name, stamp_ns, arrival_ns, value, by_arrival] : given) {
        require(
            stamp_ns.size() == value.size() && arrival_ns.size() == value.size(),
            "a series needs as many stamps and arrivals as values");
        series.push_back(
            {conditioner.find(topic, name), span_of(stamp_ns), span_of(arrival_ns), span_of(value),
             by_arrival});
    }
    std::vector<Samples> segments;
    {
        const nb::gil_scoped_release others_may_run;
        segments = condition(conditioner, series, [] {
            const nb::gil_scoped_acquire alone;
            if (PyErr_CheckSignals() != 0) throw nb::python_error();
        });
    }
    const std::size_t motors = conditioner.motors();
    nb::list found;
    for (const Samples& one : segments) {
        found.append(tuple_of(one, motors, conditioner.axes().size() - motors));
    }
    return found;
}

Written angles_of_array(const Axis& axis, const Given& readings) {
    return copy_of(angles_of(axis, span_of(readings)));
}

void bind_axis(nb::module_& core) {
    nb::class_<Axis>(core, "Axis",
        "A motor or joint: how readings become angles, and what these must satisfy.")
        .def(
            "__init__",
            [](Axis* made, std::string name, double lower, double upper, double max_speed,
               Nanoseconds clock_offset_ns, double clock_stddev, double period, double scale,
               double offset, std::vector<double> corrected_at, std::vector<double> correction,
               double bandwidth, bool adaptive, double band, double negligible, double count,
               double worth, double start) {
                require(
                    corrected_at.size() == correction.size(),
                    "a correction needs as many values as angles");
                new (made) Axis{std::move(name), lower, upper, max_speed, clock_offset_ns,
                                clock_stddev, period, scale, offset, std::move(corrected_at),
                                std::move(correction), bandwidth, adaptive, band, negligible,
                                count, worth, start};
            },
            "name"_a, nb::kw_only(), "lower"_a, "upper"_a, "max_speed"_a, "clock_offset_ns"_a,
            "clock_stddev"_a, "period"_a, "scale"_a, "offset"_a, "corrected_at"_a,
            "correction"_a, "bandwidth"_a, "adaptive"_a, "band"_a, "negligible"_a, "count"_a,
            "worth"_a, "start"_a, "Keep the numbers; see ``Axis`` in core/records.hpp.")
        .def_ro("name", &Axis::name)
        .def_ro("lower", &Axis::lower)
        .def_ro("upper", &Axis::upper)
        .def_ro("clock_offset_ns", &Axis::clock_offset_ns)
        .def_ro("adaptive", &Axis::adaptive)
        .def("angles_of", &angles_of_array, "readings"_a,
            "Angles of readings of a whole recording, acceptable or not; NaN beyond ``LARGEST``.")
        .def("angle_near", &angle_near, "reading"_a, "near"_a,
            "Angle of a single reading; of those that it may mean, that in range nearest ``near``.");
}

void bind_conditioner(nb::module_& core) {
    const auto counter = [](auto member) {
        return [member](const Conditioner& conditioner) { return conditioner.*member; };
    };
    nb::class_<Conditioner>(core, "Conditioner",
        "Gates and time line of one robot.")
        .def(
            "__init__",
            [](Conditioner* self, std::vector<Axis> axes, std::size_t motors,
               std::vector<std::vector<std::size_t>> cables, bool predict, Nanoseconds horizon_ns) {
                new (self) Conditioner(
                    std::move(axes), motors, std::move(cables), predict, horizon_ns);
            },
            "axes"_a, "motors"_a, "cables"_a, "predict"_a, "horizon_ns"_a,
            "Start without readings; ``cables``: the axes of every cable.")
        .def("feed", &feed, "topic"_a.noconvert(), "stamp_ns"_a, "names"_a, "positions"_a,
             "arrival_ns"_a = NEVER_NS, "by_arrival"_a = false,
            "Take a message; returns the fields of every ``Sample`` that is now complete.")
        .def("feed_message", &feed_message, "topic"_a.noconvert(), "message"_a,
            "``feed`` the last message that was decoded.")
        .def("refuse", &refuse, "cause"_a,
            "Count a message that is refused whole, by a cause of ``refused``.")
        .def("take_refused", &take_refused, R"(
            Largest reading refused since the last call, by axis and cause.

            It is the time by which it is late (negative) or ahead of the last accepted one [s], the
            angle where it is out of range [rad], the speed that an implausible one needs [rad/s], or 0.)")
        .def("reset", &Conditioner::reset, "keep_turns"_a = false, R"(
            Forget all readings; the counters stay.

            Args:
                keep_turns: keep the motion estimates of the axes and the count of turns of every sensor
                    with a ``period``.  Otherwise only the count is kept, and only if the next reading
                    follows within ``MAX_GAP_NS``.)")
        .def("remembered", &memory,
            "Numbers that outlast a restart, shapes (axes, 8) and (axes,).")
        .def("remember", &recall, "rows"_a, "stepped"_a,
            "Restore what ``remembered`` gave, before the first reading.")
        .def("continue_from", &expect, "angles"_a, "stamp_ns"_a,
            "Continue from the last sample of an earlier run, angles of shape (axes,) [rad].")
        .def("use_tracking_of", &Conditioner::set_tracking, "axes"_a,
            "Change the tracking bandwidths to those of ``axes``; no reading is lost.")
        .def_prop_ro("refused", &refused)
        .def_prop_ro("accepted", counter(&Conditioner::accepted))
        .def_prop_ro("elsewhere", counter(&Conditioner::elsewhere))
        .def_prop_ro("clock_jumps", counter(&Conditioner::clock_jumps))
        .def_prop_ro("gaps", counter(&Conditioner::gaps))
        .def_prop_ro("steps", counter(&Conditioner::steps))
        .def_prop_ro("crowded", [](const Conditioner& c) { return c.time_line().crowded; })
        .def_prop_ro("lag_ns", [](const Conditioner& c) { return c.time_line().lag_ns; })
        .def_prop_ro("unheard", [](const Conditioner& c) {
            return names_where(c, [](const Channel& channel) { return channel.last_ns < 0; });
        })
        .def_prop_ro("silent", [](const Conditioner& c) {
            ByName<Nanoseconds> found;
            for (std::size_t k = 0; k < c.axes().size(); ++k) {
                const Channel& channel = c.channels()[k];
                if (channel.speaks()) continue;
                found[c.axes()[k].name.c_str()] = channel.lag.silent_ns;
            }
            return found;
        },
            "How long axes have not been read for which no other has to wait [ns], by name.")
        .def_prop_ro("ahead", [](const Conditioner& c) {
            return by_name<Nanoseconds>(c, [](const Channel& channel) -> nb::object {
                if (!channel.ahead_ns) return nb::none();
                return nb::int_(*channel.ahead_ns);
            });
        },
            "Stamp of the last reading, less its time of arrival if that is known [ns], by name.")
        .def_prop_ro("displaced", [](const Conditioner& c) {
            return by_name<double>(c, [](const Channel& channel) -> nb::object {
                const StepMemory& steps = channel.steps.memory;
                if (!steps.stepped && steps.displaced == 0.0) return nb::none();
                return nb::float_(steps.displaced);
            });
        })
        .def_prop_ro("alternating", [](const Conditioner& c) {
            return names_where(c, [](const Channel& channel) { return channel.steps.alternates(); });
        })
        .def_prop_ro("stuck", [](const Conditioner& c) {
            return names_where(c, [](const Channel& channel) { return channel.steps.repeats(); });
        })
        .def_prop_ro("misfitting", [](const Conditioner& c) {
            return names_where(c, [](const Channel& channel) { return channel.misfits; });
        })
        .def_prop_ro("lagging", [](const Conditioner& c) {
            ByName<std::pair<Nanoseconds, double>> found;
            for (std::size_t k = 0; k < c.axes().size(); ++k) {
                const Channel& channel = c.channels()[k];
                if (!channel.lags(c.axes()[k])) continue;
                found[c.axes()[k].name.c_str()] =
                    nb::make_tuple(channel.lag.lag_ns, channel.lag.growth);
            }
            return found;
        },
            "Least lag behind the others [ns], and its growth, of axes where this counts, by name.")
        .def_prop_ro("held", [](const Conditioner& c) {
            std::size_t held = 0;
            for (const Channel& channel : c.channels()) {
                held += channel.held.size() + (channel.off ? 1 : 0);
            }
            return held;
        })
        .def_prop_ro("held_of", [](const Conditioner& c) {
            return by_name<List<std::pair<Nanoseconds, double>>>(c, [](const Channel& channel) -> nb::object {
                nb::list held;
                for (const Raw& raw : channel.held) {
                    held.append(nb::make_tuple(raw.stamp_ns, raw.reading));
                }
                return held;
            });
        },
            "Stamps [ns] and readings [rad] held after a possible jump of the clock, by name.")
        .def_prop_ro("waiting", [](const Conditioner& c) {
            return by_name<std::size_t>(c, [](const Channel& channel) -> nb::object {
                return nb::int_(channel.readings.size() + channel.recent.size());
            });
        },
            "Number of readings kept for later samples and for the velocity, by name.");
}

}  // namespace

void bind_conditioning(nb::module_& core) {
    core.attr("ALL_SEEN") = no_deviations();
    core.attr("NONE_CHANGED") = no_deviations();
    core.attr("NONE_FLAGGED") = no_flags();
    core.attr("MAX_GAP_NS") = MAX_GAP_NS;
    core.attr("CONFIRMATIONS") = CONFIRMATIONS;
    core.attr("RANGE_MARGIN") = RANGE_MARGIN;
    core.attr("LARGEST") = LARGEST;
    core.attr("WAITING") = WAITING;
    nb::enum_<Topic>(core, "Topic",
        "What a topic carries.")
        .value("MOTORS", Topic::motors)
        .value("JOINTS", Topic::joints)
        .value("BOTH", Topic::both);
    bind_axis(core);
    bind_conditioner(core);
    core.def("condition", &condition_recording, "conditioner"_a, "series"_a, R"(
        Take all readings of a recording in order of arrival.

        Args:
            conditioner: takes the readings.
            series: topic, name, stamps [ns], times of arrival [ns] and readings [rad] of channels, and
                whether the stamps are those times.

        Returns:
            One segment of samples, and a further one after every jump of the clock back: stamps [ns],
            shape (n,); angles of motors and of joints [rad], shapes (n, motors) and (n, joints);
            ``unseen``, shape (n, 2, axes), or (0, 0, 0) where all are zero; ``doubtful`` and
            ``after_gap``, shapes (n, axes), or (0, axes) where none is; rows that have ``offset``, and
            these, shape (rows, 2, axes).)");
    nb::class_<TrackingFilter>(core, "TrackingFilter",
        "A filter of the angle between the counts of a sensor, (C1) of docs/estimation.md.")
        .def(nb::init<>(), "Start without readings.")
        .def("track", &TrackingFilter::track, "since_ns"_a, "reading"_a, "bandwidth"_a, "band"_a,
             "adaptive"_a, R"(
            The angle at a reading [rad], within ``band`` of it.

            Args:
                since_ns: time since the reading before [ns]; ignored at the first one.
                reading: angle by the sensor [rad].
                bandwidth: of the filter [Hz], positive.
                band: greatest difference of angle and reading [rad].
                adaptive: whether the bandwidth rises with the motion, (C6).)");
}

}  // namespace cdrj
