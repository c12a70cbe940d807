# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs long work in the background (exports, proxies, photographs, imports) with progress, a way to cancel and a report at the end.

Work is a generator, created by a function of its job. The code between two `yield`s runs on the main thread, as Blender's data requires, and should take a
few milliseconds. `answer = yield in_thread(function, ...)` runs the function in a thread and waits for it; a bare `yield` gives control back to Blender. The
generator returns the report. The interface starts it with `start`; scripts and Blenders without a window run it to its end with `at_once`."""

import atexit
import contextlib
import threading
import time

import bpy

from . import draw, lens, native

SLICE = 0.02  # seconds of the main thread per turn
TICK = 0.02  # seconds between turns
current = None  # the running background job


class Cancelled(Exception):
    """Raised within a cancelled job."""


class Job:
    def __init__(self, title, work):
        self.title, self.fraction, self.what = title, 0.0, ""
        self.notes = []  # warnings for the end
        self.notice = None
        self.changes = False  # whether Blender's data changed, which requires an undo step
        self.stopped, self.lock, self.end_other = threading.Event(), threading.Lock(), None
        self.thread, self.answer = None, (None, None)
        self.steps = work(self)

    # ---- Any thread ----

    def tell(self, fraction, what):
        self.fraction, self.what = min(max(fraction, 0.0), 1.0), what

    def check(self):
        """Raises Cancelled if the job was cancelled."""
        if self.stopped.is_set():
            raise Cancelled

    def cancel(self):
        self.stopped.set()
        with self.lock:
            if self.end_other:
                self.end_other()

    @contextlib.contextmanager
    def ended_by(self, end):
        """Within it, cancelling the job calls `end`, which must end what the thread waits for."""
        with self.lock:
            self.end_other = end
        if self.stopped.is_set():
            end()
        try:
            yield
        finally:
            with self.lock:
                self.end_other = None

    # ---- Main thread ----

    def step(self, wait=False):
        """Continues to the next `yield`; True at the end. Without `wait`, returns immediately while a thread works."""
        if self.thread is not None:
            if not wait and self.thread.is_alive():
                return False
            self.thread.join()
            self.thread = None
        (value, error), self.answer = self.answer, (None, None)
        if error is None and self.stopped.is_set():
            error = Cancelled()
        try:
            wanted = self.steps.throw(error) if error else self.steps.send(value)
        except StopIteration as end:
            self.notice = end.value
            return True
        if wanted is not None:
            self.thread = threading.Thread(target=self.work_beside, args=wanted, daemon=True)
            self.thread.start()
        return False

    def work_beside(self, function, arguments):
        try:
            self.answer = (function(*arguments), None)
        except BaseException as error:
            self.answer = (None, error)

    def abort(self):
        """Ends it now, for example when another file is opened."""
        self.cancel()
        if self.thread is not None:
            self.thread.join(10)
        self.steps.close()

    def line(self):
        share = f", {100 * self.fraction:.0f} %" if self.fraction > 0 else ""
        return f"{self.title}: {'ending' if self.stopped.is_set() else self.what or 'running'}{share}"


def in_thread(function, *arguments):
    """For `yield`: a function to call in a thread. It must not touch Blender's data."""
    return function, arguments


# Errors that users can act on. All others are bugs and leave a traceback.
ERRORS = (native.SceneError, lens.LensError, OSError, RuntimeError, ValueError, KeyError, MemoryError)


def at_once(title, work):
    """Runs work to its end and returns the job."""
    job = Job(title, work)
    while not job.step(True):
        pass
    return job


def start(title, work):
    """Runs work in the background and reports its result."""
    global current
    if current is not None:
        raise native.SceneError(f"{current.title} is running; wait for its end, or cancel it in the 3D view's header")
    current = Job(title, work)
    bpy.ops.pags.job("INVOKE_DEFAULT")


def report(operator, job):
    for note in job.notes:
        operator.report({"WARNING"}, note)
    if job.notice:
        operator.report({"INFO"}, job.notice)


class Long:
    """Base of the operators on a PAGS scene with long work. A subclass defines `steps(context, root)`, which reads the operator's properties and returns the
    work; the operator itself may no longer exist when that runs."""

    by_hand = False
    errors = ERRORS

    def invoke(self, context, event):
        self.by_hand = not bpy.app.background
        return self.execute(context)

    def work(self, context, root):
        begin(self, self.steps(context, root))


def begin(operator, work):
    """Starts an operator's work in the background if called from the interface, else runs it to the end."""
    if operator.by_hand:
        start(operator.bl_label, work)
    else:
        report(operator, at_once(operator.bl_label, work))


# ---- In the window ----


class PAGS_OT_job(bpy.types.Operator):
    """Run the current job in small steps"""

    bl_idname = "pags.job"
    bl_label = "PAGS job"
    bl_options = {"INTERNAL"}

    def invoke(self, context, event):
        manager = context.window_manager
        self.timer, self.shown = manager.event_timer_add(TICK, window=context.window), None
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if current is None:  # the add-on was disabled and enabled again
            return self.end(context)
        kind, said = "ERROR", ""
        try:
            done = advance(current)
        except Cancelled:
            kind, said = "INFO", "cancelled"
        except ERRORS as error:
            said = str(error)
        except ReferenceError:  # its objects were deleted or undone meanwhile
            said = "the scene has changed; try again"
        except BaseException:
            self.end(context)
            raise
        if said:
            self.report({kind}, f"{current.title}: {said}")
            return self.end(context)
        if done:
            report(self, current)
            return self.end(context)
        if self.shown != current.line():
            self.shown = current.line()
            redraw()
        return {"PASS_THROUGH"}

    def end(self, context):
        global current
        job, current = current, None
        context.window_manager.event_timer_remove(self.timer)
        if job is not None and job.changes:
            bpy.ops.ed.undo_push(message=job.title)
        redraw()
        return {"FINISHED"}

    def cancel(self, context):
        """Called by Blender when another file is opened or the window closed."""
        abort()


def advance(job):
    """Runs the job until its time is used up or a thread works for it; True at the end."""
    end = time.perf_counter() + SLICE
    while not job.step():
        if job.thread is not None or time.perf_counter() > end:
            return False
    return True


def abort():
    global current
    if current is not None:
        job, current = current, None
        job.abort()


class PAGS_OT_cancel_job(bpy.types.Operator):
    """Cancel the running export, import or other job of PAGS and remove its output"""

    bl_idname = "pags.cancel_job"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return current is not None

    def execute(self, context):
        current.cancel()
        return {"FINISHED"}


def draw_header(self, context):
    """In the 3D view's header: the running job and a button to cancel it."""
    if current is None:
        return
    row = self.layout.row(align=True)
    if hasattr(row, "progress"):  # from Blender 4.0 on
        row.progress(factor=current.fraction, type="BAR", text=current.line())
    else:
        row.label(text=current.line(), icon="TIME")
    row.operator("pags.cancel_job", text="", icon="X")


def redraw():
    for _, area, _ in draw.regions():
        for region in (region for region in area.regions if region.type == "HEADER"):
            region.tag_redraw()


def on_register():
    bpy.types.VIEW3D_HT_header.prepend(draw_header)  # the right end of the header is often outside of the window
    atexit.register(abort)  # no program keeps running after Blender's end


def on_unregister():
    atexit.unregister(abort)
    abort()
    bpy.types.VIEW3D_HT_header.remove(draw_header)
