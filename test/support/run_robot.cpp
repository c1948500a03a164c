// A robot's recording through the core alone, without Python: standard input to standard output.
//
// In: sizes of topology and constants, number of samples, then topology, constants, motor and joint angles and
// times since the sample before. Out: the estimates.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "robot.hpp"

namespace {

template <typename T>
std::vector<T> read(std::size_t count) {
    std::vector<T> found(count);
    if (std::fread(found.data(), sizeof(T), count, stdin) != count) std::exit(1);
    return found;
}

}  // namespace

int main() {
    using namespace cdrj;
    const auto sizes = read<std::int64_t>(3);
    const auto topology = read<Index>(sizes[0]);
    const auto constants = read<double>(sizes[1]);
    const Robot robot(topology.data(), constants.data());
    const std::size_t samples = sizes[2];
    const std::size_t motors = robot.topology.sizes.motors, joints = robot.topology.sizes.joints;
    const auto motor_angle = read<double>(samples * motors);
    const auto joint_angle = read<double>(samples * joints);
    const auto dt = read<double>(samples);
    std::vector<double> state(robot.state_size()), out(robot.out_size());
    for (std::size_t k = 0; k < samples; ++k) {
        robot.advance(
            state.data(), {motor_angle.data() + k * motors, motors},
            {joint_angle.data() + k * joints, joints}, dt[k], out.data());
        std::copy_n(out.data(), state.size(), state.data());
        std::fwrite(out.data() + state.size(), sizeof(double), robot.estimate_size(), stdout);
    }
}
