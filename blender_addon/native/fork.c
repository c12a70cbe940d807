/* SPDX-License-Identifier: Apache-2.0 */
/* Objects after a fork. The child has all memory of its parent, but of its threads only the one that forked: a lock
 * that another one held stays locked, and a renderer draws no more. So every object stores its process. A lock that was
 * free at the fork works in the child, as a copy; a lost one raises an error instead of waiting forever. Call with the
 * interpreter's lock held. */
#include "blender_addon/native/native.h"

#include "port/port.h"

bool native_forked_since(int64_t process) {
  return process != pags_port_process_id();
}

bool native_lock_create(native_lock *lock) {
  lock->process = pags_port_process_id();
  lock->made = pthread_mutex_init(&lock->mutex, NULL) == 0;
  if (!lock->made)
    PyErr_SetString(PyExc_MemoryError, "no lock can be had");
  return lock->made;
}

void native_lock_destroy(native_lock *lock) {
  if (lock->made && native_lock_is_alive(lock))
    pthread_mutex_destroy(&lock->mutex);
}

bool native_lock_is_alive(native_lock *lock) {
  const int64_t process = pags_port_process_id();
  if (lock->process != process && !lock->lost) {
    lock->lost = pthread_mutex_trylock(&lock->mutex) != 0;
    if (!lock->lost)
      pthread_mutex_unlock(&lock->mutex);
    lock->process = process;
  }
  return !lock->lost;
}

bool native_lock_check(native_lock *lock, const native_state *state, const char *what) {
  if (native_lock_is_alive(lock))
    return true;
  char text[200];
  PyOS_snprintf(text, sizeof text,
                "%s: was in use by a thread of the parent process when this process was forked; make another one here, "
                "or fork while nothing is drawn",
                what);
  return native_raise_text(state, PAGS_ERROR_UNSUPPORTED, text);
}
