"""palpate: from X-ray projections to an organ you can touch.

The public names, in the order of the data. Each is imported when it is first used, so that `palpate --help` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from palpate.version import __version__ as __version__

if TYPE_CHECKING:
    from palpate.meshes.files import read_mesh as read_mesh
    from palpate.meshes.files import write_mesh as write_mesh
    from palpate.meshes.labelled import tetrahedralize as tetrahedralize
    from palpate.meshes.mesh import TetMesh as TetMesh
    from palpate.meshes.quality import mesh_quality as mesh_quality
    from palpate.reconstruction.baselines import backproject as backproject
    from palpate.reconstruction.baselines import sirt as sirt
    from palpate.reconstruction.cover import covering_grid as covering_grid
    from palpate.reconstruction.filtered import fbp as fbp
    from palpate.reconstruction.hardening import Hardened as Hardened
    from palpate.reconstruction.hardening import Polynomial as Polynomial
    from palpate.reconstruction.hardening import Spectrum as Spectrum
    from palpate.reconstruction.hardening import precorrected as precorrected
    from palpate.reconstruction.likelihood import Gaussian as Gaussian
    from palpate.reconstruction.likelihood import Transmission as Transmission
    from palpate.reconstruction.likelihood import WeightedLeastSquares as WeightedLeastSquares
    from palpate.reconstruction.prior import Prior as Prior
    from palpate.reconstruction.projector import Projector as Projector
    from palpate.reconstruction.reconstruct import iterates as iterates
    from palpate.reconstruction.reconstruct import reconstruct as reconstruct
    from palpate.reconstruction.refine import Refinement as Refinement
    from palpate.reconstruction.refine import image_shift as image_shift
    from palpate.reconstruction.refine import moved_panels as moved_panels
    from palpate.reconstruction.refine import refine as refine
    from palpate.reconstruction.refine import refined as refined
    from palpate.reconstruction.refine import view_gain as view_gain
    from palpate.reconstruction.refine import without_displacement as without_displacement
    from palpate.reconstruction.region import local_scan as local_scan
    from palpate.reconstruction.region import region_grid as region_grid
    from palpate.reconstruction.sart import sart as sart
    from palpate.reconstruction.step import Step as Step
    from palpate.reconstruction.tv import tv as tv
    from palpate.reconstruction.two_materials import TwoMaterials as TwoMaterials
    from palpate.reconstruction.two_materials import read_spectrum as read_spectrum
    from palpate.reconstruction.two_materials import two_material as two_material
    from palpate.reconstruction.two_materials import two_material_likelihood as two_material_likelihood
    from palpate.scans.correct import equal_contrast as equal_contrast
    from palpate.scans.correct import line_integrals as line_integrals
    from palpate.scans.correct import open_beam as open_beam
    from palpate.scans.files import is_scan as is_scan
    from palpate.scans.files import read_scan as read_scan
    from palpate.scans.files import write_scan as write_scan
    from palpate.scans.geometry_file import read_geometry as read_geometry
    from palpate.scans.importers import import_scan as import_scan
    from palpate.scans.motion import arc_views as arc_views
    from palpate.scans.motion import circular_views as circular_views
    from palpate.scans.motion import hypocycloid_views as hypocycloid_views
    from palpate.scans.motion import linear_views as linear_views
    from palpate.scans.motion import rotating_views as rotating_views
    from palpate.scans.phantom import Box as Box
    from palpate.scans.phantom import Common as Common
    from palpate.scans.phantom import Ellipsoid as Ellipsoid
    from palpate.scans.phantom import Phantom as Phantom
    from palpate.scans.phantom import breast_phantom as breast_phantom
    from palpate.scans.phantom import slab_phantom as slab_phantom
    from palpate.scans.plots import plot_scan as plot_scan
    from palpate.scans.readout import integrating_scan as integrating_scan
    from palpate.scans.scan import Scan as Scan
    from palpate.scans.simulate import simulate_scan as simulate_scan
    from palpate.scans.views import Panel as Panel
    from palpate.scans.views import Views as Views
    from palpate.server.serve import touch as touch
    from palpate.server.viewing import view as view
    from palpate.simulation.devices.pointer import Command as Command
    from palpate.simulation.devices.pointer import Pointer as Pointer
    from palpate.simulation.devices.replay import Replay as Replay
    from palpate.simulation.record import Record as Record
    from palpate.simulation.record import read_record as read_record
    from palpate.simulation.record import write_record as write_record
    from palpate.simulation.score import Score as Score
    from palpate.simulation.score import score as score
    from palpate.simulation.session import Session as Session
    from palpate.simulation.task import Task as Task
    from palpate.studies.deformation.study import deformation_study as deformation_study
    from palpate.studies.demo import demonstrate as demonstrate
    from palpate.studies.head_study import head_study as head_study
    from palpate.studies.realtime.study import realtime_study as realtime_study
    from palpate.studies.scores import score_report as score_report
    from palpate.studies.tomosynthesis.study import tomosynthesis_study as tomosynthesis_study
    from palpate.tissue.files import read_tissue as read_tissue
    from palpate.tissue.files import write_tissue as write_tissue
    from palpate.tissue.finite_strain import finite_strain as finite_strain
    from palpate.tissue.fit import fit as fit
    from palpate.tissue.lump import force_map as force_map
    from palpate.tissue.lump import lump_map as lump_map
    from palpate.tissue.models import model as model
    from palpate.tissue.rungs import ladder as ladder
    from palpate.tissue.supports import held_beyond as held_beyond
    from palpate.tissue.supports import held_near as held_near
    from palpate.tissue.supports import resting_on as resting_on
    from palpate.tissue.tissue import SpringLaw as SpringLaw
    from palpate.tissue.tissue import Tissue as Tissue
    from palpate.tissue.truth import finite_elements as finite_elements
    from palpate.volumes.files import read_labels as read_labels
    from palpate.volumes.files import read_volume as read_volume
    from palpate.volumes.files import write_labels as write_labels
    from palpate.volumes.files import write_volume as write_volume
    from palpate.volumes.grid import Grid as Grid
    from palpate.volumes.metrics import contrast_to_noise as contrast_to_noise
    from palpate.volumes.metrics import nmse as nmse
    from palpate.volumes.plots import plot_profile as plot_profile
    from palpate.volumes.plots import plot_volume as plot_volume
    from palpate.volumes.resample import resample as resample
    from palpate.volumes.segment import segment as segment
    from palpate.volumes.volume import Labels as Labels
    from palpate.volumes.volume import Volume as Volume

_HOME = {
    "Grid": "volumes.grid",
    "Volume": "volumes.volume",
    "Labels": "volumes.volume",
    "nmse": "volumes.metrics",
    "contrast_to_noise": "volumes.metrics",
    "read_volume": "volumes.files",
    "write_volume": "volumes.files",
    "read_labels": "volumes.files",
    "write_labels": "volumes.files",
    "plot_volume": "volumes.plots",
    "plot_profile": "volumes.plots",
    "resample": "volumes.resample",
    "segment": "volumes.segment",
    "Panel": "scans.views",
    "Views": "scans.views",
    "circular_views": "scans.motion",
    "linear_views": "scans.motion",
    "arc_views": "scans.motion",
    "rotating_views": "scans.motion",
    "hypocycloid_views": "scans.motion",
    "Scan": "scans.scan",
    "is_scan": "scans.files",
    "read_scan": "scans.files",
    "write_scan": "scans.files",
    "plot_scan": "scans.plots",
    "integrating_scan": "scans.readout",
    "import_scan": "scans.importers",
    "read_geometry": "scans.geometry_file",
    "open_beam": "scans.correct",
    "equal_contrast": "scans.correct",
    "line_integrals": "scans.correct",
    "Phantom": "scans.phantom",
    "Ellipsoid": "scans.phantom",
    "Box": "scans.phantom",
    "Common": "scans.phantom",
    "slab_phantom": "scans.phantom",
    "breast_phantom": "scans.phantom",
    "simulate_scan": "scans.simulate",
    "Projector": "reconstruction.projector",
    "covering_grid": "reconstruction.cover",
    "Transmission": "reconstruction.likelihood",
    "Gaussian": "reconstruction.likelihood",
    "WeightedLeastSquares": "reconstruction.likelihood",
    "Hardened": "reconstruction.hardening",
    "Polynomial": "reconstruction.hardening",
    "Spectrum": "reconstruction.hardening",
    "precorrected": "reconstruction.hardening",
    "TwoMaterials": "reconstruction.two_materials",
    "two_material": "reconstruction.two_materials",
    "two_material_likelihood": "reconstruction.two_materials",
    "read_spectrum": "reconstruction.two_materials",
    "Refinement": "reconstruction.refine",
    "image_shift": "reconstruction.refine",
    "moved_panels": "reconstruction.refine",
    "refine": "reconstruction.refine",
    "refined": "reconstruction.refine",
    "view_gain": "reconstruction.refine",
    "without_displacement": "reconstruction.refine",
    "Prior": "reconstruction.prior",
    "Step": "reconstruction.step",
    "backproject": "reconstruction.baselines",
    "fbp": "reconstruction.filtered",
    "sirt": "reconstruction.baselines",
    "sart": "reconstruction.sart",
    "tv": "reconstruction.tv",
    "iterates": "reconstruction.reconstruct",
    "reconstruct": "reconstruction.reconstruct",
    "region_grid": "reconstruction.region",
    "local_scan": "reconstruction.region",
    "TetMesh": "meshes.mesh",
    "tetrahedralize": "meshes.labelled",
    "mesh_quality": "meshes.quality",
    "read_mesh": "meshes.files",
    "write_mesh": "meshes.files",
    "Tissue": "tissue.tissue",
    "SpringLaw": "tissue.tissue",
    "resting_on": "tissue.supports",
    "held_near": "tissue.supports",
    "held_beyond": "tissue.supports",
    "finite_elements": "tissue.truth",
    "finite_strain": "tissue.finite_strain",
    "model": "tissue.models",
    "ladder": "tissue.rungs",
    "fit": "tissue.fit",
    "read_tissue": "tissue.files",
    "write_tissue": "tissue.files",
    "force_map": "tissue.lump",
    "lump_map": "tissue.lump",
    "Session": "simulation.session",
    "Command": "simulation.devices.pointer",
    "Pointer": "simulation.devices.pointer",
    "Replay": "simulation.devices.replay",
    "OpenHaptics": "simulation.devices.open_haptics",
    "ForceDimension": "simulation.devices.force_dimension",
    "Haply": "simulation.devices.haply",
    "find_devices": "simulation.devices.find",
    "Record": "simulation.record",
    "read_record": "simulation.record",
    "write_record": "simulation.record",
    "Score": "simulation.score",
    "Task": "simulation.task",
    "score": "simulation.score",
    "touch": "server.serve",
    "view": "server.viewing",
    "demonstrate": "studies.demo",
    "deformation_study": "studies.deformation.study",
    "head_study": "studies.head_study",
    "realtime_study": "studies.realtime.study",
    "score_report": "studies.scores",
    "tomosynthesis_study": "studies.tomosynthesis.study",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    value = getattr(import_module(f"palpate.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
