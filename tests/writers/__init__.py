"""Writers: for each format of flight recording the file its simulator or logger would have written.

They follow what is published of the format, at its own precision; they are the other side of round trips and
give the fuzzers their seeds.
"""

from __future__ import annotations

from collections.abc import Callable

from lab.missions import Recording
from writers import (
    acmi,
    ardupilot,
    fit,
    flight_recorder,
    flightgear,
    flightgear_csv,
    fslogger,
    garmin_csv,
    gpx,
    igc,
    jsbsim_csv,
    kf_gins,
    kml,
    mavlink,
    nmea,
    novatel,
    own_csv,
    sbf,
    sdlog2,
    sensor_csv,
    simconnect,
    tcx,
    ubx,
    ulog,
    xplane_data,
)

WRITERS: dict[str, Callable[[Recording], bytes | dict[str, bytes]]] = {
    "INS Lab flight csv": own_csv.write,
    "X-Plane Data.txt": xplane_data.write,
    "MSFS/FSX fsLogger csv": fslogger.write,
    "MSFS Flight Recorder csv": flight_recorder.write,
    "SimConnect csv": simconnect.write,
    "FlightGear insgns-gps and insgns-imu": flightgear.write,
    "FlightGear csv": flightgear_csv.write,
    "JSBSim csv": jsbsim_csv.write,
    "Garmin G1000 csv": garmin_csv.write,
    "GPX": gpx.write,
    "FIT": fit.write,
    "Tacview ACMI": acmi.write,
    "KML": kml.write,
    "TCX": tcx.write,
    "NMEA 0183": nmea.write,
    "u-blox UBX": ubx.write,
    "NovAtel OEM": novatel.write,
    "Septentrio SBF": sbf.write,
    "IGC": igc.write,
    "KF-GINS text": kf_gins.write,
    "PX4 ULog": ulog.write,
    "PX4 sdlog2": sdlog2.write,
    "ArduPilot DataFlash": ardupilot.write,
    "MAVLink tlog": mavlink.write,
    "csv with named columns": sensor_csv.write,
}
"""By name of the reader: what gives the bytes of a file, or of several by their names."""
