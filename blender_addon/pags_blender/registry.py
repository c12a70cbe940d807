# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers Blender's classes in a module of the add-on and what it declares, and takes them back in reverse order:

    PROPERTIES  (type of Blender, name, property)
    HANDLERS    (list in bpy.app.handlers, function)
    MENUS       (menu, function)
    DRAWN       (function, "POST_VIEW" or "POST_PIXEL"): draws in 3D views
    KEYS        (operator, key map, event)
    TIMERS      functions that run as timers, to be stopped

A module's functions `on_register` and `on_unregister` run after all this and before it is taken back."""

import bpy

KINDS = "Operator Panel Menu UIList PropertyGroup AddonPreferences RenderEngine FileHandler".split()
_undo = {}  # by module: functions that take back what was registered


def classes_of(part):
    """Blender's classes in a module, in the order of their definition."""
    kinds = tuple(getattr(bpy.types, kind) for kind in KINDS if hasattr(bpy.types, kind))
    return [
        c for c in vars(part).values() if isinstance(c, type) and issubclass(c, kinds) and c.__module__ == part.__name__
    ]


def register(part):
    undo = _undo[part] = []

    def declared(name):
        return getattr(part, name, ())

    for cls in classes_of(part):
        bpy.utils.register_class(cls)
        undo.append(lambda cls=cls: bpy.utils.unregister_class(cls))
    for owner, name, value in declared("PROPERTIES"):
        setattr(owner, name, value)
        undo.append(lambda owner=owner, name=name: delattr(owner, name))
    for users in (*declared("HANDLERS"), *declared("MENUS")):
        users[0].append(users[1])
        undo.append(lambda users=users: drop(*users))
    for function, when in () if bpy.app.background else declared("DRAWN"):
        handle = bpy.types.SpaceView3D.draw_handler_add(function, (), "WINDOW", when)
        undo.append(lambda handle=handle: bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW"))
    config = bpy.context.window_manager.keyconfigs.addon
    for cls, name, event in declared("KEYS") if config is not None else ():
        keymap = config.keymaps.new(name=name, space_type="EMPTY" if name == "Object Mode" else "VIEW_3D")
        item = keymap.keymap_items.new(cls.bl_idname, **event)
        undo.append(lambda keymap=keymap, item=item: keymap.keymap_items.remove(item))
    for function in declared("TIMERS"):
        undo.append(lambda function=function: stop(function))
    if hasattr(part, "on_unregister"):
        undo.append(part.on_unregister)
    if hasattr(part, "on_register"):
        part.on_register()


def unregister(part):
    for action in reversed(_undo.pop(part, ())):
        action()


def drop(users, function):
    """Removes a function from a list of handlers, or a menu."""
    if not isinstance(users, list) or function in users:
        users.remove(function)


def start(function, delay=0.0, persistent=False):
    """Starts a timer unless it runs; does nothing without a window."""
    if not bpy.app.background and not bpy.app.timers.is_registered(function):
        bpy.app.timers.register(function, first_interval=delay, persistent=persistent)


def stop(function):
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)
