/* SPDX-License-Identifier: Apache-2.0 */
/* What PAGS asks of the operating system: Linux, macOS or Windows behind one header. No other file of ours includes a
 * system's own header or calls what C17 doesn't have, except POSIX threads, which all three have (tests/style.py
 * checks that).
 *
 * Paths are UTF-8 and separated by '/'; on Windows '\\' separates, too, and paths may be longer than 260 characters.
 * Functions that return bool or a pointer set errno on failure. All may be called from any thread. */
#ifndef PAGS_PORT_H
#define PAGS_PORT_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* ---- Memory ---- */

/* Allocates `size` bytes at a multiple of `alignment`, a power of two >= sizeof(void *); NULL if out of memory. Such a
 * block must be freed by pags_port_aligned_free, never by free. */
void *pags_port_aligned_alloc(size_t alignment, size_t size);
void pags_port_aligned_free(void *block); /* NULL is allowed */

/* ---- Clock and resources ---- */

int64_t pags_port_clock_ns(void);        /* monotonic, with an arbitrary zero */
int64_t pags_port_thread_clock_ns(void); /* processor time of the calling thread */

/* Number of processors that this process may run on (its affinity mask), >= 1. */
int pags_port_processors(void);
/* Bytes of physical memory; UINT64_MAX if unknown. */
uint64_t pags_port_physical_memory(void);
/* Peak resident memory of this process, bytes; 0 if unknown. */
uint64_t pags_port_peak_memory(void);
/* Resident memory of this process now, bytes, with its pages of mapped files; 0 if unknown. */
uint64_t pags_port_resident_memory(void);

int64_t pags_port_process_id(void);
/* The name of this machine in a network; "" if it has none or it doesn't fit. */
void pags_port_host_name(char *name, size_t size);

/* Sets a variable of this process's environment; NULL removes it. */
bool pags_port_set_environment(const char *name, const char *value);

/* ---- Files ---- */

typedef enum pags_port_kind {
  PAGS_PORT_FILE,
  PAGS_PORT_FOLDER,
  PAGS_PORT_LINK, /* only if links are not followed */
  PAGS_PORT_SOCKET,
  PAGS_PORT_DEVICE /* a device, a FIFO or anything else */
} pags_port_kind;

typedef struct pags_port_status {
  pags_port_kind kind;
  uint64_t size; /* bytes, of a file */
  unsigned mode; /* permissions as of POSIX, 07777; write bits missing: read-only */
  bool of_proc;  /* the link lies in /proc: it leads to an open descriptor, not to a path */
} pags_port_status;

/* What lies at `path`; follow: at the end of its links. false with ENOENT if there is nothing. */
bool pags_port_stat(const char *path, bool follow, pags_port_status *status);
bool pags_port_stream_stat(FILE *stream, pags_port_status *status);
/* Whether this user may write to the file; false with EACCES or EROFS. */
bool pags_port_may_write(const char *path);
/* The text of a symbolic link; the absolute path with all links resolved. Freed by the caller. */
char *pags_port_read_link(const char *path);
char *pags_port_real_path(const char *path);

/* As fopen; a folder is opened or fails with EISDIR. */
FILE *pags_port_open(const char *path, const char *mode);
/* Opens an empty part file for writing, and locks it where the file system can; an existing file of that name is
 * emptied, a link is refused. EBUSY: another process, or another stream of this one, is writing it. */
FILE *pags_port_open_part(const char *path);
/* Closes a part file's stream and renames the file, which stays locked in between. */
bool pags_port_rename_part(FILE *stream, const char *from, const char *to);
/* Opens a path for direct writing: appends to a file, writes to a device or FIFO, connects to a
 * stream socket. A missing file is created. */
FILE *pags_port_open_straight(const char *path);
bool pags_port_sync(FILE *stream); /* flushed data to disk; true for devices that can't be synced */
bool pags_port_seek(FILE *stream, int64_t offset, int whence);
bool pags_port_is_terminal(FILE *stream);
bool pags_port_is_writable(FILE *stream); /* it is open, and for writing */

/* Renames a file; replaces a file that has the new name already. */
bool pags_port_rename(const char *from, const char *to);
bool pags_port_remove_file(const char *path);
bool pags_port_make_folder(const char *path);
bool pags_port_remove_folder(const char *path); /* fails unless it is empty */
/* Creates a file whose name ends in random characters in place of the pattern's last six, "XXXXXX", and removes it:
 * shows whether files can be made there. */
bool pags_port_try_file(char *pattern);

/* The names in a folder in no order, without "." and "..". `next` returns NULL at the end, with errno 0, or on
 * failure; the name is valid until the next call. */
typedef struct pags_port_folder pags_port_folder;
pags_port_folder *pags_port_folder_open(const char *path);
const char *pags_port_folder_next(pags_port_folder *folder);
void pags_port_folder_close(pags_port_folder *folder);

/* Locks of files, for programs that agree on a lock file. The system drops a lock when its process ends, however it
 * ends; programs that are started meanwhile don't inherit it. Two locks of one file exclude each other within a
 * process, too. */
typedef enum pags_port_lock_state {
  PAGS_PORT_LOCKED,
  PAGS_PORT_HELD,      /* by another lock */
  PAGS_PORT_NO_LOCKS,  /* the file system has none; errno says why */
  PAGS_PORT_LOCK_FAILS /* errno */
} pags_port_lock_state;

/* Creates the lock file if it is missing, locks it and writes `text` into it. If it is held, waits for a tenth of a
 * second, since a process that was killed may take that long to end, and for up to two seconds until the holder has
 * written its text; then `holder` receives the text in the file, "" without one. */
pags_port_lock_state pags_port_lock(const char *path, const char *text, intptr_t *lock, char *holder, size_t size);
/* Removes the lock file and unlocks it. */
void pags_port_unlock(const char *path, intptr_t lock);
/* Whether somebody holds a lock file, and the text in it; creates nothing. */
bool pags_port_is_locked(const char *path, char *holder, size_t size);

/* Maps a file of `size` > 0 bytes, readable and writable; writes stay in this process. */
bool pags_port_map(const char *path, uint64_t size, uint8_t **bytes);
void pags_port_unmap(uint8_t *bytes, uint64_t size);

/* ---- Locale ---- */

/* The C locale for the calling thread, entered and left, whatever the host program has set. */
typedef struct pags_port_locale {
  void *c, *previous;
} pags_port_locale;
pags_port_locale pags_port_enter_c_locale(void);
void pags_port_leave_c_locale(pags_port_locale scope);

/* ---- Signals ---- */

/* A signal mask of this thread, or nothing where there are no signals. */
typedef struct pags_port_signals {
  uint64_t mask[16];
  bool pending;
} pags_port_signals;

/* Blocks all signals, so that threads started now never run handlers; sets the mask back. */
pags_port_signals pags_port_block_signals(void);
void pags_port_restore_signals(const pags_port_signals *signals);
/* Between these, a reader that goes away makes a write fail with EPIPE and doesn't end the process. */
pags_port_signals pags_port_hold_broken_pipe(void);
void pags_port_release_broken_pipe(const pags_port_signals *held);

/* For programs, not for libraries. The handler is called on a signal or, on Windows, on another thread; `keyboard`: by
 * Ctrl-C, else by a request to end: SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU, and SIGHUP unless it was ignored when the
 * program started, as nohup does. The handler may set flags, read the clock and call pags_port_exit_at_once. */
void pags_port_on_interrupt(void (*handler)(bool keyboard));
void pags_port_exit_at_once(int code);
/* From now on a write to a broken pipe, or beyond the limit on a file's size (ulimit -f), fails and doesn't end the
 * program. Programs that this one becomes (pags_port_become) get the signals as they were. */
void pags_port_let_writes_fail(void);
/* Prints `message` and ends the program with code 1 when a mapped file turns out to be shorter than its mapping. */
void pags_port_on_lost_mapping(const char *message);
/* Makes main's arguments UTF-8 where the system gives them in another form, the console understand UTF-8, and the
 * standard streams carry bytes as they are. Reserves the descriptors of standard streams that are closed, so that no
 * file gets one: writes to such an output fail. */
void pags_port_begin_program(int *argc, char ***argv);

/* Writes the path of the running program's folder; false if it isn't known or doesn't fit into `size` bytes. */
bool pags_port_program_folder(char *path, size_t size);
/* Writes the path of the user's folder for data of PAGS, which may be missing: $XDG_DATA_HOME/pags, else
 * ~/.local/share/pags; on Windows %LOCALAPPDATA%/pags. False as above. */
bool pags_port_data_folder(char *path, size_t size);
/* Replaces this process by another program, searched in PATH unless its name has a '/', with these arguments (words[0]
 * is the program, NULL ends them). It inherits input, output and signals. Returns only if it couldn't be started. On
 * Windows this process waits for it and ends with its code. */
void pags_port_become(const char *const *words);

/* ---- Waiting ---- */

/* Locks until the end of the scope:
 *   PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock); */
static inline pthread_mutex_t *pags_mutex_lock(pthread_mutex_t *lock) {
  pthread_mutex_lock(lock);
  return lock;
}
static inline void pags_mutex_unlock(pthread_mutex_t **lock) {
  pthread_mutex_unlock(*lock);
}

/* A condition whose timed wait counts in the monotonic clock. */
bool pags_port_condition_create(pthread_cond_t *condition);
/* Waits at most `seconds`; false on a timeout. */
bool pags_port_condition_wait(pthread_cond_t *condition, pthread_mutex_t *lock, double seconds);

#endif
