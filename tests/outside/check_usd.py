# SPDX-License-Identifier: Apache-2.0
"""Prints what OpenUSD reads from a stage, as JSON: the errors found by usdchecker's validators, and the prims' contents."""

import json
import sys

from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation, UsdVol

stage = Usd.Stage.Open(sys.argv[1])
context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
errors = [f"{e.GetName()}: {e.GetMessage()}" for e in context.Validate(stage)]
out = {
    "errors": errors,
    "up": str(UsdGeom.GetStageUpAxis(stage)),
    "metres": UsdGeom.GetStageMetersPerUnit(stage),
    "default": str(stage.GetDefaultPrim().GetPath()),
    "rate": stage.GetTimeCodesPerSecond(),
    "end": stage.GetEndTimeCode(),
    "prims": {},
}
for prim in stage.Traverse():
    item = {"type": str(prim.GetTypeName()), "schemas": [str(s) for s in prim.GetAppliedSchemas()]}
    if prim.IsA(UsdVol.ParticleField3DGaussianSplat):
        splat = UsdVol.ParticleField3DGaussianSplat(prim)
        degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
        item["degree"] = degree
        item["counts"] = [
            len(prim.GetAttribute(name).Get())
            for name in ("positions", "orientations", "scales", "opacities", "radiance:sphericalHarmonicsCoefficients")
        ]
    if prim.IsA(UsdGeom.Mesh):
        mesh = UsdGeom.Mesh(prim)
        item["triangles"] = len(mesh.GetFaceVertexCountsAttr().Get())
        item["visible"] = str(mesh.GetVisibilityAttr().Get())
        item["label"] = [str(t) for t in prim.GetAttribute("semantics:labels:class").Get()]
        item["valid"] = UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), len(mesh.GetPointsAttr().Get())
        )[0]
    if prim.HasAPI(UsdPhysics.RigidBodyAPI):
        item["kinematic"] = bool(UsdPhysics.RigidBodyAPI(prim).GetKinematicEnabledAttr().Get())
    if prim.IsA(UsdGeom.Xformable):
        times = UsdGeom.Xformable(prim).GetTimeSamples()
        item["samples"] = len(times)
        moved = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(times[-1] if times else 0)
        item["last"] = [float(v) for v in moved.ExtractTranslation()]
    out["prims"][str(prim.GetPath())] = item
print(json.dumps(out))
