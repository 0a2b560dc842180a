"""IMU columns: the part of F by which constant errors of the IMU change attitude and velocity."""

from __future__ import annotations

from lab.base.arrays import FloatArray
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ATT, VEL
from lab.sensors.imu_errors import OFF_DIAGONAL

_ROWS, _COLUMNS = (["xyz".index(pair[k]) for pair in OFF_DIAGONAL] for k in (0, 1))
"""The sensor that each misalignment concerns, and the axis that it measures too."""


def write_imu_columns(
    F: FloatArray, names: tuple[str, ...], C_nb: FloatArray, rate_b: FloatArray, force_b: FloatArray
) -> None:
    """Write the columns of scale factors, misalignments and g-sensitivity that a filter has into F (m, n, n).

    Parameters
    ----------
    F : (m, n, n) array
        System matrices.
    names
        The further blocks of the filter.
    C_nb : (m, 3, 3) array
        Attitudes.
    rate_b, force_b : (m, 3) arrays
        Angular rates [rad/s] and specific forces [m/s²] in b.
    """
    for rows, sign, shown, scale, misalignment in (
        (ATT, 1, rate_b, blocks.GYRO_SCALE, blocks.GYRO_MISALIGNMENT),
        (VEL, -1, force_b, blocks.ACCEL_SCALE, blocks.ACCEL_MISALIGNMENT),
    ):
        if scale in names:
            F[:, rows, blocks.states_of(names, scale)] = sign * C_nb * shown[:, None, :]
        if misalignment in names:
            F[:, rows, blocks.states_of(names, misalignment)] = (
                sign * C_nb[:, :, _ROWS] * shown[:, None, _COLUMNS]
            )
    if blocks.GYRO_G in names:
        F[:, ATT, blocks.states_of(names, blocks.GYRO_G)] = C_nb * force_b[:, None, :]
