# SPDX-License-Identifier: Apache-2.0
"""Reads the items of Blender's menus and the add-on's panels and presses them by label. The drawing functions get a
layout that records the items. Hidden or greyed-out items can't be pressed."""

import bpy
from gui_case import addon, in_view, view3d

ROOTS = {
    "File": "TOPBAR_MT_file",
    "Render": "TOPBAR_MT_render",
    "Add": "VIEW3D_MT_add",
    "Object": "VIEW3D_MT_object",
    "View": "VIEW3D_MT_view",
}


class Button:
    def __init__(self, layout, kind, label, target, values=None):
        self.layout, self.kind, self.label, self.target = layout, kind, plain(label), target
        self.values = {} if values is None else values

    def __repr__(self):
        return f"{self.kind} {self.label!r}"


class Properties:
    """Records the properties of an operator that a panel sets, as in `layout.operator(...).step = 1`."""

    def __init__(self, values):
        object.__setattr__(self, "_values", values)

    def __setattr__(self, name, value):
        self._values[name] = value

    def __getattr__(self, name):
        return None


class Layout:
    """Replaces a UILayout; `found` collects the buttons of the layout and its rows."""

    def __init__(self, found, parent=None):
        self.found, self.parent, self.enabled = found, parent, True

    def usable(self):
        return self.enabled and (self.parent is None or self.parent.usable())

    def row(self, *arguments, **keywords):
        return Layout(self.found, self)

    column = box = split = column_flow = grid_flow = menu_pie = row

    def put(self, *arguments):
        self.found.append(Button(self, *arguments))

    def operator(self, name, *, text=None, **keywords):
        values = {}
        self.put("operator", rna(name).name if text is None else text, name, values)
        return Properties(values)

    def operator_enum(self, name, member, **keywords):
        for item in items_of(rna(name).properties[member]):
            self.put("operator", item.name, name, {member: item.identifier})

    def operator_menu_enum(self, name, member, *, text=None, **keywords):
        values = {}
        self.put("choice", text or rna(name).name, (name, member), values)
        return Properties(values)

    def prop(self, data, name, *, text=None, **keywords):
        member = data.bl_rna.properties[name]
        if data.is_property_readonly(name):
            return
        self.put("property", text or member.name, (data, name))

    def menu(self, name, *, text=None, **keywords):
        kind = getattr(bpy.types, name, None)
        if kind is not None:
            self.put("menu", text or kind.bl_label, name)

    def menu_contents(self, name, **keywords):
        draw(getattr(bpy.types, name), self)

    def template_list(self, kind, name, data, member, active, index, **keywords):
        self.put("list", data.bl_rna.properties[member].name, (data, member, active, index))

    def __getattr__(self, name):
        return lambda *arguments, **keywords: self


class Drawn:
    """Replaces the menu or panel as `self` of its drawing function."""

    def __init__(self, kind, layout):
        self.kind, self.layout, self.is_popover = kind, layout, False

    def __getattr__(self, name):
        member = getattr(self.kind, name)
        return (
            (lambda *arguments: member(self, *arguments))
            if callable(member) and not hasattr(member, "__self__")
            else member
        )


def rna(name):
    folder, _, operator = name.partition(".")
    return getattr(getattr(bpy.ops, folder), operator).get_rna_type()


def items_of(member):
    return list(member.enum_items) or list(member.enum_items_static)


def plain(label):
    """Returns the label without parentheses or dots at its end: "PAGS scene (scene.json, .ply)" becomes "PAGS
    scene"."""
    return label.split(" (")[0].rstrip(". ")


def draw(kind, layout):
    shown = Drawn(kind, layout)
    for function in getattr(kind.draw, "_draw_funcs", [kind.draw]):
        function(shown, bpy.context)


def panels():
    """Yields the visible panels of the add-on: those of the sidebar and of the Properties editor."""
    for kind in bpy.types.Panel.__subclasses__():
        if kind.__module__.startswith(addon.__name__ + ".") and (not hasattr(kind, "poll") or kind.poll(bpy.context)):
            yield kind


def buttons_of(kind):
    found = []
    draw(kind, Layout(found))
    return found


def find(path):
    """Finds the button of "Panel > Button", "Menu > Menu > Item" or "Panel > Choice > Item"; also returns the item
    of a choice."""
    words = [word.strip() for word in path.split(" > ")]
    if words[0] == "Viewport Shading":
        layout = Layout([])
        layout.prop(view3d().shading, "type", text=words[0])
        return layout.found[0], words[1]
    if words[0] in ROOTS:
        level = buttons_of(getattr(bpy.types, ROOTS[words[0]]))
    else:
        named = [kind for kind in panels() if kind.bl_label == words[0]]
        assert named, f"{path}: no panel {words[0]} is shown among {sorted(kind.bl_label for kind in panels())}"
        level = [button for kind in named for button in buttons_of(kind)]
    for number, word in enumerate(words[1:], 1):
        fits = [button for button in level if button.label == word]
        assert fits, f"{path}: no {word} is shown among {sorted({button.label for button in level})}"
        if fits[0].kind != "menu":
            break
        level = buttons_of(getattr(bpy.types, fits[0].target))
    rest = words[number + 1 :]
    assert len(rest) <= 1, f"{path}: {word} holds no further choices"
    assert fits[0].layout.usable(), f"{path} is greyed out"
    return fits[0], rest[0] if rest else None


def identifier_of(member, name):
    found = [item.identifier for item in items_of(member) if item.name == name]
    assert found, f"there is no {name} among {[item.name for item in items_of(member)]}"
    return found[0]


def call(name, values):
    """Calls the operator as a click on its button does."""
    folder, _, operator = name.partition(".")
    function = getattr(getattr(bpy.ops, folder), operator)
    with in_view():
        assert function.poll(), f"{name} can't be called here"
        answer = function("INVOKE_DEFAULT", True, **values)
    assert answer & {"FINISHED", "RUNNING_MODAL", "INTERFACE"}, f"{name} ended with {answer}"


def press(path, value=None):
    """Presses the item of the path; `value` is typed into a field."""
    with in_view():
        button, item = find(path)
    if button.kind == "operator":
        assert item is None and value is None, f"{path} is a button"
        call(button.target, button.values)
    elif button.kind == "choice":
        name, member = button.target
        call(name, {**button.values, member: identifier_of(rna(name).properties[member], item)})
    elif button.kind == "property":
        put(path, *button.target, item, value)
    else:
        raise AssertionError(f"{path} is a {button.kind}")


def put(path, data, name, item, value):
    member = data.bl_rna.properties[name]
    if member.type == "POINTER":
        assert item in bpy.data.objects, f"{path}: there is no object {item}"
        setattr(data, name, bpy.data.objects[item])
    elif member.type == "ENUM":
        setattr(data, name, identifier_of(member, item))
    elif member.type == "BOOLEAN":
        assert item is None and value is None, f"{path} is a switch"
        setattr(data, name, not getattr(data, name))
    else:
        assert value is not None, f"{path} is a field: nothing is said of its value"
        setattr(data, name, value if member.type == "STRING" else type(getattr(data, name))(value))
