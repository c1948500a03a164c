"""Places of a MuJoCo model's sites and geoms in random poses within the joint ranges."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

POSES: Final = 200
"""Number of poses, in addition to the model's own."""


@dataclass(frozen=True)
class SampledPlaces:
    """Positions in all poses."""

    sites: NDArray[np.float64]
    """[m], shape (poses, sites, 3)."""
    geoms: NDArray[np.float64]
    """[m], shape (poses, geoms, 3)."""
    turned: NDArray[np.float64]
    """Rotation matrices of the geoms by rows, shape (poses, geoms, 3, 3)."""

    def nearest(self, site: int, geom: int, *, level: bool) -> float:
        """Smallest distance of a site from a geom's centre, or with ``level`` from its axis [m]."""
        away = self.sites[:, site] - self.geoms[:, geom]
        if level:
            away = np.einsum("pji,pj->pi", self.turned[:, geom], away)[:, :2]
        return float(np.linalg.norm(away, axis=1).min())


def joint_ranges(mujoco: ModuleType, model: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper end of every joint's range; ±180° or ±1 m for joints without limits."""
    most = np.where(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, 1.0, np.pi)
    limited = model.jnt_limited.astype(bool)
    low = np.where(limited, model.jnt_range[:, 0], -most)
    return low, np.where(limited, model.jnt_range[:, 1], most)


def sample_places(mujoco: ModuleType, model: Any) -> SampledPlaces:
    """Place all sites and geoms in random poses; ball and free joints stay at the model's pose."""
    data = mujoco.MjData(model)
    low, high = joint_ranges(mujoco, model)
    single = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    addresses = model.jnt_qposadr[single]
    generator = np.random.default_rng(0)
    sites, geoms, turned = [], [], []
    for k in range(POSES + 1):
        data.qpos[:] = model.qpos0
        if k > 0:
            data.qpos[addresses] = generator.uniform(low[single], high[single])
        mujoco.mj_kinematics(model, data)
        sites.append(data.site_xpos.copy())
        geoms.append(data.geom_xpos.copy())
        turned.append(data.geom_xmat.reshape(-1, 3, 3).copy())
    return SampledPlaces(np.array(sites), np.array(geoms), np.array(turned))
