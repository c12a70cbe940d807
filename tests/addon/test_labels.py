# SPDX-License-Identifier: Apache-2.0
"""Tests texts of the interface: short labels, units, reasons why items are greyed out, legends with the picture's
colours, correct counts, and no outdated values."""

import os
import sys
import types

import bpy
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "cli")]
from blender_case import BlenderCase, addon, main, pixel  # noqa: E402
from fixtures import ply_bytes, some_splats  # noqa: E402

LONGEST = 34  # letters in a line of the sidebar at its default width
UNITS = (
    "pixel",
    "metre",
    "frame",
    "second",
    "share",
    "0 to 1",
    "thread",
    "degree",
    "point",
    "number",
    "photograph",
    "fy/fx",
    "stops",
    "factor",
    "sensor",
    "grey",
    "picture",
)


def part(name):
    return sys.modules[f"{addon.__name__}.{name}"]


class Layout:
    """Replaces a panel's layout; records its items: (kind, name or text, whether it can be used)."""

    def __init__(self, found=None, above=None):
        self.found = [] if found is None else found
        self.above, self.own = above, True

    @property
    def enabled(self):
        return self.own and (self.above is None or self.above.enabled)

    @enabled.setter
    def enabled(self, value):
        self.own = value

    def inner(self, **_):
        return Layout(self.found, self)

    row = column = box = split = inner

    def label(self, text="", icon=""):
        self.found.append(("label", text, self.enabled))

    def prop(self, block, name, text=None, **_):
        self.found.append(("prop", block.bl_rna.properties[name].name if text is None else text, self.enabled))

    def operator(self, name, text=None, **_):
        module, function = name.split(".")
        label = getattr(getattr(bpy.ops, module), function).get_rna_type().name if text is None else text
        self.found.append(("operator", label, self.enabled))
        return types.SimpleNamespace()

    def operator_menu_enum(self, name, _, **__):
        self.operator(name)

    def separator(self, *_, **__):
        pass

    menu = separator

    def __getattr__(self, name):
        if not name.startswith("template_"):
            raise AttributeError(name)
        return self.separator


class Labels(BlenderCase):
    def view(self, shading="RENDERED"):
        """Returns a context like that of a 3D view's sidebar."""
        space = types.SimpleNamespace(
            shading=types.SimpleNamespace(type=shading),
            overlay=types.SimpleNamespace(show_overlays=True, show_text=True),
        )
        own = ("scene", "active_object", "object", "view_layer", "preferences", "window_manager", "engine")
        return types.SimpleNamespace(space_data=space, **{name: getattr(bpy.context, name, None) for name in own})

    def drawn(self, panel, shading="RENDERED"):
        """Returns the items of a panel: (kind, name or text, whether it can be used)."""
        context = self.view(shading)
        if hasattr(panel, "poll") and not panel.poll(context):
            return []
        layout = Layout()
        panel.draw(types.SimpleNamespace(layout=layout), context)
        return layout.found

    def panels(self):
        return [cls for cls in bpy.types.Panel.__subclasses__() if cls.__module__.startswith(addon.__name__ + ".")]

    def in_sidebar(self):
        return [cls for cls in self.panels() if cls.bl_space_type == "VIEW_3D"]

    def can_be_used(self, panel, name, shading="RENDERED"):
        return next(enabled for _, text, enabled in self.drawn(panel, shading) if text == name)

    def said(self, panel, shading="RENDERED"):
        return " ".join(text for kind, text, _ in self.drawn(panel, shading) if kind == "label")

    def test_lines_fit_into_the_sidebar(self):
        self.write("some.ply", ply_bytes(some_splats()))
        for name in ("scene", "some.ply"):
            self.bring_in(name)
            self.scene.pags_picked = "Long-winded class of things an-identifier-of-36-letters-as-data-sets-have (number 1), S_sem 1.00, depth 9.00 m"
            for shading in ("RENDERED", "SOLID", "WIREFRAME"):
                for panel in self.in_sidebar():
                    for kind, text, _ in self.drawn(panel, shading):
                        self.assertLessEqual(
                            len(text), LONGEST if kind == "label" else LONGEST - 6, f"{panel.__name__}: {text}"
                        )

    def test_long_errors_are_shown_completely(self):
        root = self.bring_in()
        part("native").forget()
        root.pags.path = self.path("a folder that is nowhere", "and has a long name")
        for thread in [part("native").cached[p].thread for p in list(part("native").cached)]:
            thread.join()
        panel = bpy.types.PAGS_PT_scene
        self.drawn(panel)
        part("native").cached[root.pags.path].thread.join()
        said = self.said(panel)
        for word in ("nowhere", "long name"):
            self.assertIn(word, said)

    def test_numbers_have_units(self):
        without = []
        for module in addon.PARTS:
            for cls in addon.registry.classes_of(module):
                for name, kind in cls.__dict__.get("__annotations__", {}).items():
                    words = getattr(kind, "keywords", {})
                    if kind.function.__name__ not in {"IntProperty", "FloatProperty"} or "HIDDEN" in words.get(
                        "options", ()
                    ):
                        continue
                    told = (words.get("name", "") + " " + words.get("description", "")).lower()
                    if (
                        words.get("unit", "NONE") == "NONE"
                        and words.get("subtype", "NONE") == "NONE"
                        and not any(u in told for u in UNITS)
                    ):
                        without.append(f"{cls.__name__}.{name}: {told}")
        self.assertEqual(without, [])

    def test_custom_properties_say_what_they_are(self):
        self.bring_in()
        car = self.part(1)
        self.assertIn("metres", car.id_properties_ui("pags_size").as_dict()["description"])
        self.assertIn("Gaussians", self.part(-1).id_properties_ui("pags_gaussians").as_dict()["description"])
        lines = part("ui").facts(car)
        for line in ("Class: Car", "Critical: yes", "Gaussians: 1", "Size: 4.00 x 2.00 x 1.50 m"):
            self.assertIn(line, lines)

    def test_kind_can_not_be_chosen(self):
        """No panel lets a user set which part of a scene an object represents."""
        root = self.bring_in()
        bpy.context.view_layer.objects.active = self.part(1)
        for panel in self.panels():
            self.assertNotIn("Part", [text for kind, text, _ in self.drawn(panel) if kind == "prop"], panel.__name__)
        self.assertIn("Object: A labelled object and its Gaussians", self.said(bpy.types.PAGS_PT_object))
        self.assertEqual(self.part(1).pags.root, root)

    def test_without_a_scene_there_is_one_button(self):
        found = [
            line
            for panel in self.in_sidebar()
            for line in self.drawn(panel)
            if panel.__module__ == addon.__name__ + ".ui"
        ]
        self.assertEqual(found, [("operator", "Import PAGS scene", True)])

    def test_recorded_exposure(self):
        self.bring_in()
        panel = bpy.types.PAGS_PT_settings
        self.scene.render.engine = "PAGS"
        self.assertTrue(self.can_be_used(panel, "Recorded exposure"))
        own = bpy.data.objects.new("own", bpy.data.cameras.new("own"))
        self.scene.collection.objects.link(own)
        self.scene.camera = own
        self.assertFalse(self.can_be_used(panel, "Recorded exposure"))
        self.assertIn("not from the recording", self.said(panel))

    def test_exposure_that_training_did_not_find(self):
        import json

        with open(self.path("scene", "scene.json"), encoding="utf-8") as file:
            record = json.load(file)
        for view in record["cameras"]:
            view["gain"], view["offset"] = [1, 1, 1], [0, 0, 0]
        self.write(os.path.join("scene", "scene.json"), json.dumps(record))
        self.bring_in()
        self.scene.render.engine = "PAGS"
        self.assertFalse(self.can_be_used(bpy.types.PAGS_PT_settings, "Recorded exposure"))
        self.assertIn("found no exposures", self.said(bpy.types.PAGS_PT_settings))

    def test_harmonics_of_other_modes(self):
        self.bring_in()
        self.scene.render.engine = "PAGS"
        for mode, usable in (("rgb", True), ("depth", False)):
            self.scene.pags.mode = mode
            self.assertEqual(self.can_be_used(bpy.types.PAGS_PT_settings, "SH degree"), usable)

    def test_critical_only_for_a_splat_file(self):
        self.write("some.ply", ply_bytes(some_splats()))
        self.bring_in("some.ply")
        panel, settings = bpy.types.PAGS_PT_show, self.scene.pags
        self.assertFalse(self.can_be_used(panel, "Critical only"))
        settings.hide_noncritical = True  # a script can set this; the user can switch it off
        self.assertTrue(self.can_be_used(panel, "Critical only"))
        self.assertIn("no vehicles", self.said(panel))
        self.bring_in()
        settings.hide_noncritical = False
        self.assertTrue(self.can_be_used(panel, "Critical only"))

    def test_settings_of_each_view(self):
        """A view's panel shows only settings that have an effect in that view."""
        self.bring_in()
        names = {
            s: {text for kind, text, _ in self.drawn(bpy.types.PAGS_PT_show, s)}
            for s in ("RENDERED", "SOLID", "WIREFRAME")
        }
        deadline, among, points = "Deadline (ms)", "Splats among meshes", "Preview points"
        self.assertEqual(
            [deadline in names["RENDERED"], among in names["RENDERED"], points in names["RENDERED"]],
            [True, False, False],
        )
        self.assertEqual(
            [deadline in names["SOLID"], among in names["SOLID"], points in names["SOLID"]], [True, True, False]
        )
        self.assertEqual(
            [deadline in names["WIREFRAME"], among in names["WIREFRAME"], points in names["WIREFRAME"]],
            [False, False, True],
        )
        self.scene.pags.overlay = False
        found = {text for kind, text, _ in self.drawn(bpy.types.PAGS_PT_show, "SOLID")}
        self.assertEqual([deadline in found, among in found, points in found], [False, True, True])

    def test_cameras_of_a_splat_file(self):
        self.write("some.ply", ply_bytes(some_splats()))
        self.bring_in("some.ply")
        panel = bpy.types.PAGS_PT_cameras
        for name in ("Nearest photograph", "Camera along the drive", "Show photographs"):
            self.assertFalse(self.can_be_used(panel, name), name)
        self.assertIn("no photographs", self.said(panel))
        self.assertFalse(self.can_be_used(bpy.types.PAGS_PT_export, "Save edited scene"))
        self.assertIn("not a scene folder", self.said(bpy.types.PAGS_PT_export))
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        self.bring_in()
        for name in ("Nearest photograph", "Camera along the drive", "Show photographs"):
            self.assertTrue(self.can_be_used(panel, name), name)

    def test_critical_only_hides_the_sky(self):
        """The option "Critical only" hides the sky in every mode: it is black, the user's background, or
        transparent."""
        self.bring_in()
        self.scene.frame_set(2)
        settings = self.scene.pags
        self.assertGreater(pixel(self.f12(), 90, 90)[2], 100)
        settings.hide_noncritical = True
        for mode in ("rgb", "critical", "depth"):
            settings.mode = mode
            picture = self.f12()
            self.assertEqual(pixel(picture, 90, 90), (0, 0, 0))
            self.assertGreater(max(pixel(picture, 50, 50)), 100)
        settings.mode, settings.use_background, settings.background = "rgb", True, (0.2, 0.4, 0.8)
        self.assertEqual(pixel(self.f12(), 90, 90), (51, 102, 204))
        settings.use_background = False
        gather = part("gather")
        frame = gather.gather(bpy.context.evaluated_depsgraph_get()).load(True)
        frame.scenes.append(types.SimpleNamespace(root_name="another"))
        self.assertEqual(frame.remarks(settings), "2 scenes")
        settings.hide_noncritical = False
        self.assertEqual(frame.remarks(settings), "2 scenes, sky of scene")

    def test_counts_agree(self):
        root = self.bring_in()
        entry = part("native").load(self.path("scene"))
        self.assertEqual(entry.info["gaussians"], 3)
        parts = [o for o in self.scene.objects if o.pags.kind in {"OBJECT", "BACKGROUND"}]
        self.assertEqual([root["pags_gaussians"], sum(o["pags_gaussians"] for o in parts)], [3, 3])
        self.assertEqual(self.said(bpy.types.PAGS_PT_scene), "3 Gaussians, 2 objects")
        frame = part("gather").gather(bpy.context.evaluated_depsgraph_get()).load(True)
        stats = {"gaussians": 3, "shaded": 2, "in_view": 2, "loaded": 2, "hidden": 0, "ms": 4.2}
        self.assertEqual(frame.counts(stats), "3 Gaussians, 1 culled, 4 ms")
        self.assertEqual(frame.counts({**stats, "gaussians": 2}), "3 Gaussians, 1 absent at this time, 0 culled, 4 ms")
        self.assertEqual(
            frame.counts({**stats, "gaussians": 4, "hidden": 1}),
            "3 Gaussians, 4 with duplicates, 2 culled, 4 ms (1 by Early-Z)",
        )
        jobs, importer = part("jobs"), part("importer")
        options = types.SimpleNamespace(
            **{name: bpy.ops.import_scene.pags.get_rna_type().properties[name].default for name in importer.OPTIONS}
        )
        job = jobs.at_once("test", lambda job: importer.bring_in(job, self.path("scene"), options, []))
        self.assertIn("scene: 3 Gaussians, 2 objects", job.notice)

    def test_legends_have_the_picture_s_colours(self):
        """The legend's colour of a value is the colour of a pixel with that value. The legend's numbers rise from
        end to end."""
        self.bring_in()
        self.scene.frame_set(2)
        legend, inspector, lens = part("legend"), part("inspector"), part("lens")
        camera = self.scene.camera
        values, pose = lens.of_camera(camera.data, camera.matrix_world, 101, 101)
        found = inspector.pick(bpy.context, values, pose, 50, 50)
        for mode, value in (("priority", found["priority"]), ("depth", found["depth"]), ("size", 0.1)):
            self.scene.pags.mode = mode
            told = legend.color(mode, legend.share(mode, value))
            for a, b in zip(pixel(self.f12(mode), 50, 50), told):
                self.assertAlmostEqual(a, 255 * b, delta=3, msg=mode)
            places = [legend.share(mode, v) for v, _ in legend.SCALES[mode][3]]
            self.assertEqual((places[0], places[-1]), (0, 1))
            self.assertEqual(places, sorted(places))
        self.scene.pags.mode = "critical"
        shown = np.array(pixel(self.f12("critical"), 50, 50), float)
        orange, grey = (np.array(color) for color, _ in legend.KINDS)
        self.assertGreater(shown @ orange / np.linalg.norm(shown) / np.linalg.norm(orange), 0.95)
        self.assertGreater(shown[0] - shown[2], 100)
        self.assertEqual(grey[0], grey[1])

    def test_every_mode_has_a_legend(self):
        legend = part("legend")
        modes = {item.identifier for item in self.scene.pags.bl_rna.properties["mode"].enum_items}
        self.assertEqual(modes - {"rgb"}, set(legend.SCALES) | {"critical"})
        self.bring_in()
        for mode in modes:
            self.scene.pags.mode = mode
            self.assertEqual(legend.shows(self.view()), mode != "rgb")
        self.assertFalse(legend.shows(self.view("WIREFRAME")))
        self.assertEqual(legend.note(self.scene), "")
        self.scene.view_settings.view_transform = "Filmic" if bpy.app.version < (4, 0, 0) else "AgX"
        self.assertIn(self.scene.view_settings.view_transform, legend.note(self.scene))

    def test_outdated_pick_disappears(self):
        self.bring_in()
        bpy.context.view_layer.update()
        car = self.part(1)

        def gone(change):
            self.scene.pags_picked = "Car c=2, depth 9.00 m"
            change()
            bpy.context.view_layer.update()
            return self.scene.pags_picked == ""

        self.assertFalse(gone(lambda: car.select_set(True)))
        self.assertFalse(gone(lambda: setattr(self.scene.camera, "location", (1, 0, 0))))
        self.assertTrue(gone(lambda: self.scene.frame_set(2)))
        self.assertTrue(gone(lambda: setattr(car, "location", (1, 0, 0))))
        self.assertTrue(gone(lambda: setattr(car, "hide_viewport", True)))
        self.assertTrue(gone(lambda: setattr(self.scene.pags, "hide_noncritical", True)))
        self.assertTrue(gone(lambda: bpy.ops.pags.reload()))
        bpy.ops.ed.undo_push(message="moved")
        car.location.y += 1
        bpy.ops.ed.undo_push(message="moved again")
        self.assertTrue(gone(lambda: bpy.ops.ed.undo()))
        self.assertTrue(gone(lambda: bpy.ops.ed.redo()))
        self.assertTrue(gone(lambda: bpy.data.objects.remove(self.part(1))))
        self.scene.pags_picked = "Car c=2, depth 9.00 m"
        bpy.ops.wm.save_as_mainfile(filepath=self.path("a.blend"))
        bpy.ops.wm.open_mainfile(filepath=self.path("a.blend"))
        self.assertEqual(self.scene.pags_picked, "")


if __name__ == "__main__":
    main()
