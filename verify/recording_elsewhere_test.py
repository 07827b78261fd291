#!/usr/bin/env python3
"""A recording, read by h5py as docs/recording-format.md says and by VTK as ParaView does, gives the same numbers.

    recording_elsewhere_test.py VERIFY_TEST    the test program writes the recording
"""
import os
import subprocess
import sys
import tempfile

import h5py
import numpy
import vtk
from vtk.util.numpy_support import vtk_to_numpy


def check(holds, what):
    if not holds:
        sys.exit("recording_elsewhere_test: " + what)


with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, "run.h5")
    environment = dict(os.environ, SULCUS_KEEP_RECORDING=path)
    subprocess.run([sys.argv[1], "--gtest_brief=1", "--gtest_filter=Recording.IsKeptForOtherReaders"],
                   env=environment, check=True)

    run = h5py.File(path)
    steps = run.attrs["steps"]
    force = run["series/tools/0/contact_force_N"]
    check(force.shape == (steps, 3), "the force has shape %s" % (force.shape,))
    check(force.attrs["unit"] == b"N" or force.attrs["unit"] == "N", "the force has no unit")
    check(numpy.isfinite(force[:]).all() and numpy.abs(force[:]).max() > 0, "the force is not there")
    check(run["fingerprint/chain"].shape == (steps + 1,), "the chain has another length than the run")
    positions = run["frames/positions_m"]
    frames, nodes = positions.shape[0], positions.shape[1] // 3
    tets = run["mesh/tets"].shape[0] // 4
    check(frames > 2, "there are %d frames" % frames)
    every = run["VTKHDF/Points"][:].reshape(frames, 3 * nodes)
    check((every == positions[:]).all(), "VTKHDF shows other positions than the frames have")
    alive = run["VTKHDF/CellData/alive"][:].reshape(frames, tets)
    check((alive == run["frames/alive"][:]).all(), "VTKHDF shows other elements as present than the frames do")

    reader = vtk.vtkHDFReader()
    check(reader.CanReadFile(path), "VTK cannot read the file")
    reader.SetFileName(path)
    reader.UpdateInformation()
    steps_key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    information = reader.GetOutputInformation(0)
    times = information.Get(steps_key) if information.Has(steps_key) else None
    for frame in range(frames) if times else [0]:  # VTK up to 9.2 knows no steps and shows the first frame
        if times:
            check(times[frame] == run["frames/time_s"][frame], "VTK has other times")
            reader.UpdateTimeStep(times[frame])
        else:
            reader.Update()
        grid = reader.GetOutputDataObject(0)
        check(grid.GetNumberOfPoints() == nodes and grid.GetNumberOfCells() == tets, "VTK sees another mesh")
        points = vtk_to_numpy(grid.GetPoints().GetData())
        check((points.ravel() == positions[frame]).all(), "VTK sees other positions in frame %d" % frame)
        corners = [grid.GetCell(tets - 1).GetPointId(corner) for corner in range(4)]
        check(corners == list(run["mesh/tets"][-4:]), "VTK sees another last element")
        check(grid.GetCellType(0) == vtk.VTK_TETRA, "VTK sees no tetrahedra")
        stress = vtk_to_numpy(grid.GetCellData().GetArray("stress_Pa"))
        expected = run["frames/stress_Pa"][frame]
        check(numpy.array_equal(stress, expected, equal_nan=True), "VTK sees another stress")
    print("h5py %s and VTK %s read the recording: %d steps, %d frames" %
          (h5py.__version__, vtk.vtkVersion().GetVTKVersion(), steps, frames))
