"""Running an estimator: over a log, over many, or sample by sample, with one and the same step."""

from roadstate.run.batch import batch
from roadstate.run.chunk import CHUNK
from roadstate.run.scan import scan
from roadstate.run.smooth import smooth
from roadstate.run.stream import Arrival, Stream

__all__ = ["CHUNK", "Arrival", "Stream", "batch", "scan", "smooth"]
