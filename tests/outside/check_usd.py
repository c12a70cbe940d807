# SPDX-License-Identifier: Apache-2.0
"""check_usd.py STAGE [TIME]: reads a stage by OpenUSD and prints as JSON the errors of usdchecker's validators and
the prims' contents, at the time code TIME if given."""

import json
import sys

from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation, UsdVol

stage = Usd.Stage.Open(sys.argv[1])
time = Usd.TimeCode(float(sys.argv[2])) if len(sys.argv) > 2 else None
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


def height_over(mesh, when):
    """Returns the largest height of the mesh above its origin on the vertical line through the origin, in world
    coordinates; None if the line misses the mesh."""
    to_world = UsdGeom.Xformable(mesh.GetPrim()).ComputeLocalToWorldTransform(when)
    points = [to_world.Transform(p) for p in mesh.GetPointsAttr().Get()]
    corners, origin, best = mesh.GetFaceVertexIndicesAttr().Get(), to_world.ExtractTranslation(), None
    for i in range(0, len(corners), 3):
        a, b, c = (points[j] for j in corners[i : i + 3])
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if not area:
            continue
        u = ((origin[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (origin[1] - a[1])) / area
        v = ((b[0] - a[0]) * (origin[1] - a[1]) - (origin[0] - a[0]) * (b[1] - a[1])) / area
        if u >= 0 and v >= 0 and u + v <= 1:
            height = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]) - origin[2]
            best = height if best is None else max(best, height)
    return best


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
    if prim.HasAttribute("semantics:labels:class"):
        item["label"] = [str(t) for t in prim.GetAttribute("semantics:labels:class").Get()]
    if prim.IsA(UsdGeom.Mesh):
        mesh = UsdGeom.Mesh(prim)
        item["triangles"] = len(mesh.GetFaceVertexCountsAttr().Get())
        item["visible"] = str(mesh.GetVisibilityAttr().Get())
        item["valid"] = UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), len(mesh.GetPointsAttr().Get())
        )[0]
        if time is not None:
            item["height"] = height_over(mesh, time)
    if prim.HasAPI(UsdPhysics.RigidBodyAPI):
        item["kinematic"] = bool(UsdPhysics.RigidBodyAPI(prim).GetKinematicEnabledAttr().Get())
    if prim.HasAPI(UsdPhysics.CollisionAPI):
        item["collides"] = bool(
            UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get(time or Usd.TimeCode.Default())
        )
        item["shape"] = str(UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get())
    if prim.IsA(UsdGeom.Imageable) and time is not None:
        item["seen"] = str(UsdGeom.Imageable(prim).ComputeVisibility(time))
    if prim.IsA(UsdGeom.Xformable):
        times = UsdGeom.Xformable(prim).GetTimeSamples()
        item["samples"] = len(times)
        when = time if time is not None else times[-1] if times else 0
        item["last"] = [
            float(v) for v in UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(when).ExtractTranslation()
        ]
    if prim.GetCustomData():
        item["number"] = prim.GetCustomDataByKey("number")
        item["track"] = prim.GetCustomDataByKey("track")
    out["prims"][str(prim.GetPath())] = item
print(json.dumps(out))
