"""isorig: iso-velocity tests of pneumatic artificial muscles, from Python (docs/python.md).

    Recording   a recording in the format that isorig exchanges with other programs
    Run         a run's directory: every sample, event and input
    Export      an HDF5 export of a run (needs h5py)
    Diagnosis   what `isorig diagnose` wrote
    Model       a model.toml of forces: simulate, predict, refit
    ResponseModel  one of positions or pressures: predict
    Rig         start, watch and stop runs through the daemon
    Live        the rig's samples as they come, with what was missed

Sign and frame, everywhere: extension and tension positive, position relative to the unpressurized rest length, pressure
gauge. Units stand in every name: mm, N, psi, s.
"""

from . import _native
from .client import Rig, default_socket
from .diagnosis import Diagnosis, Effect, Estimate
from .errors import BadInput, DataLost, IsorigError, NoAnswer, NoDaemon, Refused, Tripped
from .export import Export
from .live import GapCounter, Live, Message
from .log import LogEvent, read_log
from .model import Drive, Model, Number, Prediction, Stepper
from .recording import Recording, Specimen
from .response import Answer, ResponseModel
from .run import Run
from .session import Event, PlannedStep, Session, Setpoints, Stream
from .tables import Table, Tables

__version__ = _native.version()

__all__ = [
    "Answer", "BadInput", "DataLost", "Diagnosis", "Drive", "Effect", "Estimate", "Event", "Export", "GapCounter", "IsorigError", "Live", "LogEvent",
    "Message", "Model", "NoAnswer", "NoDaemon", "Number", "PlannedStep", "Prediction", "Recording", "Refused", "ResponseModel", "Rig", "Run", "Session",
    "Setpoints", "Specimen", "Stepper", "Stream", "Table", "Tables", "Tripped", "default_socket", "read_log",
]
