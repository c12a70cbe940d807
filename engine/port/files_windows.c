/* SPDX-License-Identifier: Apache-2.0 */
/* Files and folders (port.h) by Windows's wide functions. */
#ifdef _WIN32
#include "port/windows.h"

#include <errno.h>
#include <fcntl.h>
#include <io.h>
#include <share.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* ---- Paths and errors ---- */

wchar_t *pags_port_wide(const char *text) {
  const int count = MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, text, -1, NULL, 0);
  wchar_t *wide = count > 0 ? malloc((size_t)count * sizeof *wide) : NULL;
  if (!wide) {
    errno = count > 0 ? ENOMEM : EILSEQ;
    return NULL;
  }
  MultiByteToWideChar(CP_UTF8, 0, text, -1, wide, count);
  return wide;
}

char *pags_port_narrow(const wchar_t *text) {
  const int count = WideCharToMultiByte(CP_UTF8, 0, text, -1, NULL, 0, NULL, NULL);
  char *narrow = count > 0 ? malloc((size_t)count) : NULL;
  if (!narrow) {
    errno = count > 0 ? ENOMEM : EILSEQ;
    return NULL;
  }
  WideCharToMultiByte(CP_UTF8, 0, text, -1, narrow, count, NULL, NULL);
  return narrow;
}

/* A path for Windows's functions: with '\\' and, where it is long, absolute and behind "\\?\", which lifts the limit of
 * 260 characters. Freed by the caller; NULL with errno. */
static wchar_t *path_of(const char *path) {
  wchar_t *wide = pags_port_wide(path);
  if (!wide)
    return NULL;
  for (wchar_t *at = wide; *at; at++)
    if (*at == L'/')
      *at = L'\\';
  if (wcslen(wide) < 240 || wcsncmp(wide, L"\\\\?\\", 4) == 0)
    return wide;
  const DWORD size = GetFullPathNameW(wide, 0, NULL, NULL);
  wchar_t *full = size ? malloc((size + 8) * sizeof *full) : NULL;
  if (!full) {
    free(wide);
    errno = ENOMEM;
    return NULL;
  }
  const bool shared = wcsncmp(wide, L"\\\\", 2) == 0; /* \\server\share becomes \\?\UNC\server\share */
  wchar_t *at = full + (shared ? 6 : 4);
  GetFullPathNameW(wide, size, at, NULL);
  memcpy(full, shared ? L"\\\\?\\UNC" : L"\\\\?\\", (shared ? 7 : 4) * sizeof *full);
  free(wide);
  return full;
}

static void set_errno(void) {
  switch (GetLastError()) {
    case ERROR_FILE_NOT_FOUND:
    case ERROR_PATH_NOT_FOUND:
    case ERROR_INVALID_NAME:
    case ERROR_BAD_NETPATH: errno = ENOENT; break;
    case ERROR_ACCESS_DENIED:
    case ERROR_SHARING_VIOLATION:
    case ERROR_LOCK_VIOLATION: errno = EACCES; break;
    case ERROR_FILE_EXISTS:
    case ERROR_ALREADY_EXISTS: errno = EEXIST; break;
    case ERROR_DIR_NOT_EMPTY: errno = ENOTEMPTY; break;
    case ERROR_DISK_FULL: errno = ENOSPC; break;
    case ERROR_NOT_ENOUGH_MEMORY:
    case ERROR_OUTOFMEMORY: errno = ENOMEM; break;
    case ERROR_WRITE_PROTECT: errno = EROFS; break;
    default: errno = EIO;
  }
}

/* Sets errno by Windows's last error; returns false. */
static bool fail(void) {
  set_errno();
  return false;
}

/* ---- What lies at a path ---- */

static void describe(DWORD attributes, uint64_t size, bool link, pags_port_status *out) {
  *out = (pags_port_status){
      .kind = link                                    ? PAGS_PORT_LINK
              : attributes & FILE_ATTRIBUTE_DIRECTORY ? PAGS_PORT_FOLDER
              : attributes & FILE_ATTRIBUTE_DEVICE    ? PAGS_PORT_DEVICE
                                                      : PAGS_PORT_FILE,
      .size = size,
      .mode = attributes & FILE_ATTRIBUTE_READONLY && !(attributes & FILE_ATTRIBUTE_DIRECTORY) ? 0444 : 0666};
}

/* Describes an open file; false, with Windows's error, if that isn't one. */
static bool describe_open(HANDLE file, pags_port_status *out) {
  BY_HANDLE_FILE_INFORMATION info;
  if (file == INVALID_HANDLE_VALUE || !GetFileInformationByHandle(file, &info))
    return false;
  describe(info.dwFileAttributes & ~(DWORD)FILE_ATTRIBUTE_REPARSE_POINT,
           (uint64_t)info.nFileSizeHigh << 32 | info.nFileSizeLow, false, out);
  return true;
}

/* Opens what lies at the end of a path's links, for its attributes and its name only. */
static HANDLE open_to_look(const wchar_t *path) {
  return CreateFileW(path, 0, FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE, NULL, OPEN_EXISTING,
                     FILE_FLAG_BACKUP_SEMANTICS, NULL);
}

/* Names like NUL and CON are devices in every folder. */
static bool is_device_name(const char *path) {
  static const char *const names[] = {"NUL", "CON", "PRN", "AUX", "CONIN$", "CONOUT$"};
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (_stricmp(path, names[i]) == 0)
      return true;
  return false;
}

bool pags_port_stat(const char *path, bool follow, pags_port_status *status) {
  if (is_device_name(path)) {
    describe(FILE_ATTRIBUTE_DEVICE, 0, false, status);
    return true;
  }
  AUTO_WIDE *wide = path_of(path);
  WIN32_FILE_ATTRIBUTE_DATA data;
  if (!wide)
    return false;
  if (!GetFileAttributesExW(wide, GetFileExInfoStandard, &data))
    return fail();
  const bool link = data.dwFileAttributes & FILE_ATTRIBUTE_REPARSE_POINT;
  if (link && follow) {
    AUTO_HANDLE file = open_to_look(wide);
    return describe_open(file, status) || fail();
  }
  describe(data.dwFileAttributes, (uint64_t)data.nFileSizeHigh << 32 | data.nFileSizeLow, link, status);
  return true;
}

bool pags_port_stream_stat(FILE *stream, pags_port_status *status) {
  const HANDLE file = (HANDLE)_get_osfhandle(_fileno(stream));
  if (GetFileType(file) == FILE_TYPE_DISK)
    return describe_open(file, status) || fail();
  describe(FILE_ATTRIBUTE_DEVICE, 0, false, status);
  return true;
}

bool pags_port_may_write(const char *path) {
  AUTO_WIDE *wide = path_of(path);
  return wide && _waccess(wide, 2) == 0;
}

char *pags_port_real_path(const char *path) {
  AUTO_WIDE *wide = path_of(path);
  AUTO_HANDLE file = wide ? open_to_look(wide) : INVALID_HANDLE_VALUE;
  const DWORD size = file != INVALID_HANDLE_VALUE ? GetFinalPathNameByHandleW(file, NULL, 0, 0) : 0;
  AUTO_WIDE *full = size ? malloc((size + 1) * sizeof *full) : NULL;
  if (!full || !GetFinalPathNameByHandleW(file, full, size + 1, 0)) {
    if (wide)
      set_errno();
    return NULL;
  }
  /* Without "\\?\" where the rest is a drive's path; '/' separates, as everywhere here. */
  char *narrow = pags_port_narrow(wcsncmp(full, L"\\\\?\\", 4) == 0 && full[4] && full[5] == L':' ? full + 4 : full);
  for (char *at = narrow; at && *at && *narrow != '\\'; at++)
    if (*at == '\\')
      *at = '/';
  return narrow;
}

char *pags_port_read_link(const char *path) {
  return pags_port_real_path(path); /* final target of the link, which is all that callers need */
}

/* ---- Streams ---- */

FILE *pags_port_open(const char *path, const char *mode) {
  AUTO_WIDE *wide = path_of(path), *wide_mode = pags_port_wide(mode);
  FILE *stream = wide && wide_mode ? _wfopen(wide, wide_mode) : NULL;
  if (!stream && wide && errno == EACCES) {
    const DWORD attributes = GetFileAttributesW(wide);
    errno = attributes != INVALID_FILE_ATTRIBUTES && attributes & FILE_ATTRIBUTE_DIRECTORY ? EISDIR : EACCES;
  }
  return stream;
}

FILE *pags_port_open_part(const char *path) {
  AUTO_WIDE *wide = path_of(path);
  FILE *stream = wide ? _wfsopen(wide, L"wb", _SH_DENYWR) : NULL;
  if (!stream && wide && GetLastError() == ERROR_SHARING_VIOLATION)
    errno = EBUSY;
  return stream;
}

bool pags_port_rename_part(FILE *stream, const char *from, const char *to) {
  return fclose(stream) == 0 && pags_port_rename(from, to); /* an open file can't be renamed */
}

FILE *pags_port_open_straight(const char *path) {
  return pags_port_open(path, is_device_name(path) ? "wb" : "ab"); /* devices have no end */
}

bool pags_port_sync(FILE *stream) {
  const HANDLE file = (HANDLE)_get_osfhandle(_fileno(stream));
  return GetFileType(file) != FILE_TYPE_DISK || _commit(_fileno(stream)) == 0;
}

bool pags_port_seek(FILE *stream, int64_t offset, int whence) {
  return _fseeki64(stream, offset, whence) == 0;
}

bool pags_port_is_terminal(FILE *stream) {
  return _isatty(_fileno(stream)) != 0;
}

bool pags_port_is_writable(FILE *stream) {
  return _fileno(stream) >= 0;
}

/* ---- Names ---- */

bool pags_port_rename(const char *from, const char *to) {
  AUTO_WIDE *old_name = path_of(from), *new_name = path_of(to);
  if (!old_name || !new_name)
    return false;
  /* A program that looks at the file for a moment (a virus scanner, an indexer) makes the first tries fail. */
  for (int i = 0; i < 20; i++) {
    if (MoveFileExW(old_name, new_name, MOVEFILE_REPLACE_EXISTING | MOVEFILE_WRITE_THROUGH))
      return true;
    const DWORD error = GetLastError();
    if (error != ERROR_ACCESS_DENIED && error != ERROR_SHARING_VIOLATION)
      break;
    Sleep(10);
  }
  return fail();
}

typedef BOOL(WINAPI *name_fn)(LPCWSTR path);

static bool call(name_fn fn, const char *path) {
  AUTO_WIDE *wide = path_of(path);
  return wide && (fn(wide) || fail());
}

static BOOL WINAPI make_folder(LPCWSTR path) {
  return CreateDirectoryW(path, NULL);
}

bool pags_port_remove_file(const char *path) {
  return call(DeleteFileW, path);
}

bool pags_port_make_folder(const char *path) {
  return call(make_folder, path);
}

bool pags_port_remove_folder(const char *path) {
  return call(RemoveDirectoryW, path);
}

bool pags_port_try_file(char *pattern) {
  static const char letters[] = "abcdefghijklmnopqrstuvwxyz012345";
  char *end = pattern + strlen(pattern) - 6;
  for (uint64_t i = 0, seed = GetTickCount64() ^ (uint64_t)GetCurrentProcessId() << 20; i < 100; i++) {
    for (int k = 0; k < 6; k++)
      end[k] = letters[(seed + i * 2654435761u) >> (5 * k) & 31];
    AUTO_WIDE *wide = path_of(pattern);
    const HANDLE file = wide ? CreateFileW(wide, GENERIC_WRITE, 0, NULL, CREATE_NEW, FILE_FLAG_DELETE_ON_CLOSE, NULL)
                             : INVALID_HANDLE_VALUE;
    if (file == INVALID_HANDLE_VALUE && wide)
      set_errno();
    if (file != INVALID_HANDLE_VALUE)
      return CloseHandle(file) != 0;
    if (errno != EEXIST)
      return false;
  }
  return false;
}

struct pags_port_folder {
  HANDLE find;
  WIN32_FIND_DATAW entry;
  bool first;
  char *name;
};

pags_port_folder *pags_port_folder_open(const char *path) {
  pags_port_folder *folder = calloc(1, sizeof *folder);
  const size_t length = strlen(path);
  char *pattern = folder ? malloc(length + 3) : NULL;
  if (pattern) {
    memcpy(pattern, path, length);
    memcpy(pattern + length, "/*", 3);
  }
  AUTO_WIDE *wide = pattern ? path_of(pattern) : NULL;
  if (!pattern)
    errno = ENOMEM;
  free(pattern);
  if (wide) {
    folder->find = FindFirstFileW(wide, &folder->entry);
    folder->first = true;
    if (folder->find != INVALID_HANDLE_VALUE)
      return folder;
    set_errno();
  }
  free(folder);
  return NULL;
}

const char *pags_port_folder_next(pags_port_folder *folder) {
  for (;;) {
    errno = 0;
    if (!folder->first && !FindNextFileW(folder->find, &folder->entry)) {
      if (GetLastError() != ERROR_NO_MORE_FILES)
        set_errno();
      return NULL;
    }
    folder->first = false;
    if (wcscmp(folder->entry.cFileName, L".") == 0 || wcscmp(folder->entry.cFileName, L"..") == 0)
      continue;
    free(folder->name);
    folder->name = pags_port_narrow(folder->entry.cFileName);
    return folder->name;
  }
}

void pags_port_folder_close(pags_port_folder *folder) {
  FindClose(folder->find);
  free(folder->name);
  free(folder);
}

/* ---- Locks ---- */

/* A lock is an open file that nobody else may write to meanwhile; Windows removes it when it is closed, also when its
 * process is killed. Others may read it if they share it for deletion, too. */
static HANDLE open_lock(const wchar_t *path, bool read_only) {
  return read_only ? CreateFileW(path, GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE, NULL,
                                 OPEN_EXISTING, FILE_ATTRIBUTE_NORMAL, NULL)
                   : CreateFileW(path, GENERIC_READ | GENERIC_WRITE | DELETE, FILE_SHARE_READ | FILE_SHARE_DELETE, NULL,
                                 OPEN_ALWAYS, FILE_ATTRIBUTE_HIDDEN | FILE_FLAG_DELETE_ON_CLOSE, NULL);
}

static void read_text(const wchar_t *path, char *text, size_t size) {
  DWORD got = 0;
  AUTO_HANDLE file = open_lock(path, true);
  text[0] = '\0';
  if (file != INVALID_HANDLE_VALUE && ReadFile(file, text, (DWORD)size - 1, &got, NULL))
    text[got] = '\0';
}

pags_port_lock_state pags_port_lock(const char *path, const char *text, intptr_t *lock, char *holder, size_t size) {
  enum { TRIES = 5, TRIES_WITHOUT_HOLDER = 100 }; /* a holder may not have written its name yet */
  holder[0] = '\0';
  AUTO_WIDE *wide = path_of(path);
  pags_port_lock_state state = PAGS_PORT_LOCK_FAILS;
  for (int i = 0; wide && i < (holder[0] ? TRIES : TRIES_WITHOUT_HOLDER); i++) {
    const HANDLE file = open_lock(wide, false);
    if (file != INVALID_HANDLE_VALUE) {
      DWORD written;
      SetEndOfFile(file);
      WriteFile(file, text, (DWORD)strlen(text), &written, NULL); /* on a full disk the lock holds without its text */
      FlushFileBuffers(file);
      *lock = (intptr_t)file;
      return PAGS_PORT_LOCKED;
    }
    const DWORD error = GetLastError();
    /* A file that is being deleted answers that access is denied, and so does a folder that can't be written to. */
    state = error == ERROR_SHARING_VIOLATION ? PAGS_PORT_HELD : PAGS_PORT_LOCK_FAILS;
    if (error != ERROR_SHARING_VIOLATION && error != ERROR_ACCESS_DENIED) {
      set_errno();
      break;
    }
    read_text(wide, holder, size);
    SetLastError(error);
    set_errno();
    Sleep(20);
  }
  return state;
}

void pags_port_unlock(const char *path, intptr_t lock) {
  (void)path; /* removed by the system */
  CloseHandle((HANDLE)lock);
}

bool pags_port_is_locked(const char *path, char *holder, size_t size) {
  AUTO_WIDE *wide = path_of(path);
  if (!wide)
    return false;
  /* A successful exclusive open shows that no process holds the lock. */
  const HANDLE file = CreateFileW(wide, GENERIC_READ | GENERIC_WRITE, FILE_SHARE_READ | FILE_SHARE_DELETE, NULL,
                                  OPEN_EXISTING, FILE_ATTRIBUTE_NORMAL, NULL);
  const bool held = file == INVALID_HANDLE_VALUE && GetLastError() == ERROR_SHARING_VIOLATION;
  if (file != INVALID_HANDLE_VALUE)
    CloseHandle(file);
  read_text(wide, holder, size);
  return held;
}

/* ---- Mapping ---- */

bool pags_port_map(const char *path, uint64_t size, uint8_t **bytes) {
  AUTO_WIDE *wide = path_of(path);
  *bytes = NULL;
  if (!wide)
    return false;
  AUTO_HANDLE file = CreateFileW(wide, GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_DELETE, NULL, OPEN_EXISTING,
                                 FILE_ATTRIBUTE_NORMAL, NULL);
  AUTO_HANDLE mapping =
      file != INVALID_HANDLE_VALUE
          ? CreateFileMappingW(file, NULL, PAGE_WRITECOPY, (DWORD)(size >> 32), (DWORD)(size & 0xffffffffu), NULL)
          : NULL;
  if (mapping)
    *bytes = MapViewOfFile(mapping, FILE_MAP_COPY, 0, 0, (SIZE_T)size); /* the view keeps both */
  return *bytes || fail();
}

void pags_port_unmap(uint8_t *bytes, uint64_t size) {
  (void)size;
  UnmapViewOfFile(bytes);
}

#else
typedef int pags_port_files_are_in_files_posix;
#endif
