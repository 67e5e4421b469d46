"""Runs in pvpython: reads a tissue and a pressed one, and prints as JSON what ParaView finds in them.

pvpython paraview_check.py tissue.vtu pressed.vtu picture.png
"""

import json
import sys

from paraview.simple import (
    Calculator,
    ColorBy,
    IntegrateVariables,
    OpenDataFile,
    Render,
    ResetCamera,
    SaveScreenshot,
    Show,
    WarpByVector,
)


def data(source):
    """Its points, cells, bounds and arrays."""
    source.UpdatePipeline()
    found = source.GetDataInformation()
    arrays = {
        kind: {table.GetArray(k).Name: list(table.GetArray(k).GetRange()) for k in range(len(table))}
        for kind, table in (("points", source.PointData), ("cells", source.CellData))
    }
    bounds = list(found.GetBounds())
    count = {"points": found.GetNumberOfPoints(), "cells": found.GetNumberOfCells()}
    return {"count": count, "bounds": bounds, **arrays}


tissue, pressed = OpenDataFile(sys.argv[1]), OpenDataFile(sys.argv[2])
size = Calculator(Input=pressed, ResultArrayName="size", Function="mag(displacement)")
warped = WarpByVector(Input=size, Vectors=["POINTS", "displacement"])
shown = Show(warped)
ColorBy(shown, ("POINTS", "size"))
ResetCamera()
Render()
SaveScreenshot(sys.argv[3])
volume = IntegrateVariables(Input=tissue)
volume.UpdatePipeline()
print(
    json.dumps(
        {
            "tissue": data(tissue),
            "size": data(size)["points"]["size"],
            "warped": data(warped)["bounds"],
            "volume": volume.CellData.GetArray("Volume").GetRange()[0],
        }
    )
)
