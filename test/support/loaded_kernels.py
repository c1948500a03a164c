"""Importing this module loads the kernels of the estimator from disk, which takes 0.1 s."""

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model

_LIVE = LiveEstimator(load_model("prototype"))
for _stamp_ns in (10**9, 10**9 + 10**6, 10**9 + 2 * 10**6):
    _LIVE.feed("joints", _stamp_ns, ("elbow",), (0.0,))
    _LIVE.feed("motors", _stamp_ns, ("winch",), (0.0,))
