/* SPDX-License-Identifier: Apache-2.0 */
/* A bump allocator over a few growing heap chunks. A reset replaces them by one chunk of the size that was needed, so
 * that after the first rounds no heap call is made any more. Under AddressSanitizer, memory that isn't handed out is
 * poisoned and blocks are separated by gaps, so that overruns and stale pointers are caught as with malloc. */
#include <pags/tasks.h>

#include <assert.h>
#include <stdlib.h>

#include "port/port.h"

#if defined(__SANITIZE_ADDRESS__)
#define PAGS_ARENA_ASAN 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define PAGS_ARENA_ASAN 1
#endif
#endif

#if defined(PAGS_ARENA_ASAN)
#include <sanitizer/asan_interface.h>

enum { GAP = 64 };
#else
#define ASAN_POISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
enum { GAP = 0 };
#endif

/* One cache line, and one AVX-512 register. */
enum { ALIGNMENT = 64 };
enum { FIRST_CHUNK = 64 * 1024 };
/* Each new chunk is as large as all earlier ones together (unless memory is short), so that 64 of them exceed the
 * address space. */
enum { CHUNKS_MAX = 64 };

typedef struct chunk {
  unsigned char *bytes;
  size_t capacity;
  size_t used;
  size_t before; /* bytes in use in earlier chunks since this one became current */
} chunk;

struct pags_arena {
  chunk chunks[CHUNKS_MAX];
  size_t count;      /* chunks that exist */
  size_t current;    /* index of the chunk being filled; later chunks are empty */
  size_t high_water; /* most bytes ever in use at once */
  uint64_t heap_calls;
};

pags_arena *pags_arena_create(void) {
  pags_arena *arena = calloc(1, sizeof *arena);
  if (arena)
    arena->heap_calls = 1;
  return arena;
}

static void free_chunks(pags_arena *arena) {
  for (size_t i = 0; i < arena->count; ++i) {
    ASAN_UNPOISON_MEMORY_REGION(arena->chunks[i].bytes, arena->chunks[i].capacity);
    pags_port_aligned_free(arena->chunks[i].bytes);
    ++arena->heap_calls;
  }
  arena->count = 0;
  arena->current = 0;
}

void pags_arena_destroy(pags_arena *arena) {
  if (!arena)
    return;
  free_chunks(arena);
  free(arena);
}

/* Appends a chunk of at least `capacity` bytes (a multiple of ALIGNMENT). */
static bool add_chunk(pags_arena *arena, size_t capacity) {
  if (arena->count == CHUNKS_MAX)
    return false;
  ++arena->heap_calls;
  unsigned char *bytes = pags_port_aligned_alloc(ALIGNMENT, capacity);
  if (!bytes)
    return false;
  ASAN_POISON_MEMORY_REGION(bytes, capacity);
  arena->chunks[arena->count++] = (chunk){.bytes = bytes, .capacity = capacity};
  return true;
}

static size_t in_use(const pags_arena *arena) {
  if (arena->count == 0)
    return 0;
  const chunk *c = &arena->chunks[arena->current];
  return c->before + c->used;
}

/* Makes a later chunk that has room for `bytes` the current one; appends a new chunk if necessary. */
static bool advance(pags_arena *arena, size_t bytes) {
  size_t used_before = in_use(arena);
  size_t next = arena->count == 0 ? 0 : arena->current + 1;
  while (next < arena->count && arena->chunks[next].capacity < bytes)
    ++next;
  if (next == arena->count) {
    size_t grown = 0;
    for (size_t i = 0; i < arena->count; ++i)
      grown += arena->chunks[i].capacity;
    size_t capacity = grown > FIRST_CHUNK ? grown : FIRST_CHUNK;
    /* If the heap cannot give a chunk that doubles the total, a chunk of just `bytes` is tried. */
    if (!(bytes < capacity && add_chunk(arena, capacity)) && !add_chunk(arena, bytes))
      return false;
  }
  for (size_t i = arena->current + 1; i < next; ++i)
    arena->chunks[i].used = 0;
  arena->current = next;
  arena->chunks[next].used = 0;
  arena->chunks[next].before = used_before;
  return true;
}

void *pags_arena_alloc(pags_arena *arena, size_t count, size_t size) {
  if (size != 0 && count > SIZE_MAX / size)
    return NULL;
  size_t wanted = count * size;
  if (wanted > SIZE_MAX - 2 * ALIGNMENT - GAP)
    return NULL;
  /* An empty block still gets an address of its own. */
  size_t bytes = ((wanted ? wanted : 1) + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT + GAP;
  chunk *c = &arena->chunks[arena->current];
  if (arena->count == 0 || bytes > c->capacity - c->used) {
    if (!advance(arena, bytes))
      return NULL;
    c = &arena->chunks[arena->current];
  }
  unsigned char *block = c->bytes + c->used;
  c->used += bytes;
  if (in_use(arena) > arena->high_water)
    arena->high_water = in_use(arena);
  ASAN_UNPOISON_MEMORY_REGION(block, wanted);
  return block;
}

void pags_arena_reset(pags_arena *arena) {
  if (arena->count > 1) {
    /* A quarter more than was ever needed, so that a slowly growing scene doesn't need a new chunk every frame. */
    size_t capacity = arena->high_water;
    if (capacity < SIZE_MAX / 2)
      capacity += capacity / 4 / ALIGNMENT * ALIGNMENT;
    free_chunks(arena);
    /* If this fails, the next allocation tries to add a chunk again and reports the failure. */
    (void)add_chunk(arena, capacity);
  }
  pags_arena_release(arena, (pags_arena_mark){0, 0});
}

pags_arena_mark pags_arena_save(const pags_arena *arena) {
  return (pags_arena_mark){.chunk = arena->current, .used = arena->count ? arena->chunks[arena->current].used : 0};
}

void pags_arena_release(pags_arena *arena, pags_arena_mark mark) {
  assert(mark.chunk <= arena->current);
  if (arena->count == 0)
    return;
  for (size_t i = mark.chunk; i <= arena->current; ++i) {
    size_t kept = i == mark.chunk ? mark.used : 0;
    assert(kept <= arena->chunks[i].used);
    ASAN_POISON_MEMORY_REGION(arena->chunks[i].bytes + kept, arena->chunks[i].used - kept);
    arena->chunks[i].used = kept;
  }
  arena->current = mark.chunk;
}

size_t pags_arena_high_water(const pags_arena *arena) {
  return arena->high_water;
}

uint64_t pags_arena_heap_calls(const pags_arena *arena) {
  return arena->heap_calls;
}
