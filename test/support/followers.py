"""The law of linear maps: joints that follow others are those of the robot that measures them."""

import numpy as np

from cdrj_ros.estimation.estimator import Sample, initial_state, step


def assert_same_tensions_and_work(
    led, every, follow, motion, *, motors=None, compared=slice(None), effort=1e-9, share=1e-10
):
    """Step two robots along a motion, and compare tensions, efforts and the work of the joints.

    Args:
        led: robot some of whose joints follow others.
        every: the same robot with all joints measured.
        follow: angles of all joints of ``every`` from those of ``led``, an affine function.
        motion: angles of the joints of ``led``, shape (n, joints).
        motors: angles of all motors, shape (n,); 0 by default.
        compared: elements whose tensions are compared.
        effort: largest difference of efforts, relative.
        share: largest difference of works, relative.
    """
    count = motion.shape[1]
    slopes = np.stack([follow(one) - follow(np.zeros(count)) for one in np.eye(count)], axis=1)
    states, work = [initial_state(led), initial_state(every)], np.zeros(2)
    drums = np.zeros(len(motion)) if motors is None else motors
    before = motion[0]
    for k, angles in enumerate(motion):
        turned = np.full(len(led.robot.motors), drums[k])
        results = [
            step(model, state, Sample(10**9 + k * 10**7, turned, joints))
            for model, state, joints in zip(
                (led, every), states, (angles, follow(angles)), strict=True
            )
        ]
        states = [state for state, _ in results]
        one, other = (estimate for _, estimate in results)
        assert one.solved
        np.testing.assert_allclose(
            one.tension[compared], other.tension[compared], rtol=1e-9, atol=1e-9
        )
        np.testing.assert_allclose(
            one.joint_effort, other.joint_effort @ slopes, rtol=effort, atol=1e-10
        )
        change = angles - before
        work += one.joint_effort @ change, other.joint_effort @ (slopes @ change)
        before = angles
    assert abs(work[0]) > 0.0
    np.testing.assert_allclose(work[0], work[1], rtol=share)
