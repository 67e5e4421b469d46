"""A module of 3D Slicer: a segment becomes an organ in palpate, and is touched in a browser.

In 3D Slicer: Edit > Application Settings > Modules > Additional module paths: add this file's folder, and restart. The module
stands in the category Simulation. palpate itself runs in a process of its own, by 3D Slicer's Python.
"""

import shutil
import tempfile
from pathlib import Path

import qt
import slicer
import vtk
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)

WAYS = {  # towards what the organ lies on, in patient space (LPS)
    "its back": "0,1,0",
    "its front": "0,-1,0",
    "its lower end": "0,0,-1",
    "its upper end": "0,0,1",
}


class Palpate(ScriptedLoadableModule):
    """What 3D Slicer lists."""

    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Palpate"
        parent.categories = ["Simulation"]
        parent.dependencies = ["Segmentations"]
        parent.contributors = ["the authors of palpate"]
        parent.helpText = (
            "Makes an organ of a segment, and opens it in a browser, where it can be pushed, pulled, cut and felt. "
            "Research software, not a medical device."
        )
        parent.acknowledgementText = ""


class PalpateWidget(ScriptedLoadableModuleWidget):
    """The panel: a segment, its constants, and two buttons."""

    def setup(self):
        """Called by 3D Slicer."""
        ScriptedLoadableModuleWidget.setup(self)
        self.logic = PalpateLogic()
        form = qt.QFormLayout()
        self.segment = slicer.qMRMLSegmentSelectorWidget()
        self.segment.setMRMLScene(slicer.mrmlScene)
        self.edge = number(4.0, 0.5, 50.0, " mm")
        self.young = number(5.0, 0.01, 100000.0, " kPa")
        self.poisson = number(0.45, 0.0, 0.499, "", 0.01)
        self.restOn = qt.QComboBox()
        self.restOn.addItems(list(WAYS))
        self.touchButton, self.closeButton = qt.QPushButton("Touch"), qt.QPushButton("Close the simulator")
        self.touchButton.connect("clicked()", self.onTouch)
        self.closeButton.connect("clicked()", self.logic.closeSimulator)
        for label, widget in (
            ("Segment", self.segment),
            ("Length of edges", self.edge),
            ("Young's modulus", self.young),
            ("Poisson's ratio", self.poisson),
            ("Lies on", self.restOn),
        ):
            form.addRow(label, widget)
        form.addRow(self.touchButton)
        form.addRow(self.closeButton)
        self.layout.addLayout(form)
        self.layout.addStretch(1)

    def onTouch(self):
        """Meshes the segment and opens it; an error is shown in a window."""
        with slicer.util.tryWithErrorDisplay("palpate could not make an organ of this segment", waitCursor=True):
            node, segment = self.segment.currentNode(), self.segment.currentSegmentID()
            if node is None or not segment:
                raise ValueError("There is no segment: make one in the module Segment Editor, and choose it here.")
            self.logic.touch(
                node, segment, self.edge.value, self.young.value, self.poisson.value, WAYS[self.restOn.currentText]
            )

    def cleanup(self):
        """Called by 3D Slicer when the module goes."""
        self.logic.closeSimulator()


class PalpateLogic(ScriptedLoadableModuleLogic):
    """From a segment to the simulator, by the commands of palpate."""

    def __init__(self):
        ScriptedLoadableModuleLogic.__init__(self)
        self.simulator = None

    def touch(self, node, segment, edge, young, poisson, restOn):
        """Writes the segment, makes a tissue of it, and opens that. Raises what a command that fails does."""
        self.closeSimulator()
        installPalpate()
        folder = Path(tempfile.mkdtemp(prefix="palpate-slicer-"))
        labels, mesh, tissue = (folder / name for name in ("labels.nrrd", "mesh.vtu", "tissue.vtu"))
        writeSegment(node, segment, labels)
        run("mesh", labels, "--label", 1, "--edge", edge, "-o", mesh)
        run("fit", mesh, "--young", young, "--poisson", poisson, "--rest-on", restOn, "-o", tissue)
        self.simulator = start("touch", tissue)
        return tissue

    def closeSimulator(self):
        """Ends the simulator, if it runs."""
        if self.simulator is not None:
            self.simulator.terminate()
            self.simulator.wait()
            self.simulator = None


def number(value, low, high, suffix, step=0.5):
    """A field for a number."""
    field = qt.QDoubleSpinBox()
    field.setRange(low, high)
    field.setDecimals(3)
    field.setSingleStep(step)
    field.setSuffix(suffix)
    field.setValue(value)
    return field


def installPalpate():
    """Installs palpate into 3D Slicer's Python, once."""
    try:
        import palpate  # noqa: F401 - only whether it is there
    except ImportError:
        slicer.util.pip_install("palpate")


def writeSegment(node, segment, path):
    """Writes one segment as a label map whose only label is 1."""
    ids = vtk.vtkStringArray()
    ids.InsertNextValue(segment)
    labelmap = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode")
    try:
        logic = slicer.modules.segmentations.logic()
        if not logic.ExportSegmentsToLabelmapNode(node, ids, labelmap):
            raise RuntimeError("The segment cannot be exported as a label map.")
        if not slicer.util.saveNode(labelmap, str(path)):
            raise RuntimeError(f"{path} cannot be written.")
    finally:
        slicer.mrmlScene.RemoveNode(labelmap)


def start(*words):
    """Starts a command of palpate in a process of its own, in 3D Slicer's environment."""
    python = shutil.which("PythonSlicer")  # 3D Slicer puts it on the path
    if python is None:
        raise RuntimeError("PythonSlicer is not on the path of 3D Slicer.")
    words = [python, "-m", "palpate", *map(str, words)]
    return slicer.util.launchConsoleProcess(words, useStartupEnvironment=False)


def run(*words):
    """Runs a command of palpate to its end; its output goes to 3D Slicer's log. Raises if it fails."""
    slicer.util.logProcessOutput(start(*words))
