/* SPDX-License-Identifier: Apache-2.0 */
/* A frame drawn slab of depth by slab, front to back, so that what lies behind saturated pixels is never read: the
 * frame is its own depth pre-pass.
 *
 * Clusters are taken in the order of a lower bound of their members' keys, some thousand Gaussians at a time. When
 * the next cluster's bound is K, every Gaussian whose key is below K has been read, so that those among them that
 * haven't been drawn yet are a contiguous run of the frame's order (key, id): they are sorted, binned and blended onto
 * what is there. The others wait. After each slab, tiles all of whose pixels have stopped are full.
 *
 * Why the picture is that of PAGS_EARLY_Z_OFF to the bit:
 *   (a) stretch after stretch, each pixel runs the same kernel over the same list, its state kept as it is in
 *     between;
 *   (b) a pixel stops by itself, whatever its neighbours or its place in a list;
 *   (c) transmittance never grows, rounding being monotone: a pixel that has stopped stays so whatever is left out
 *     behind;
 *   (d) what is left out lies behind, and only full pixels' blocks are in its reach: K is a lower bound of the keys
 *     as floats, and reaches hold every pixel that the rasteriser could find (cull.c, project.inl);
 *   (e) pixels beyond the picture's edge count as full.
 * The same holds of PAGS_EARLY_Z_BOUNDED, compared with a frame without slabs whose pixels stop at T <= eps too: where
 * the cuts between slabs lie, and so how many there are, changes no bit in either mode.
 *
 * Bounded: let a pixel stop with T <= eps where OFF goes on. Until then both have done the same. OFF then adds
 * sum(w_k c_k) + T' s, w_k >= 0 summing to T - T', s the sky's colour, where this adds T s. The difference is sum(w_k
 * (c_k - s)); colours are >= 0, so |c_k - s| <= max(c_k, s), and no channel is off by more than T max(c, s) <= eps
 * times the largest of shaded colours, sky and background. Rounding adds, in OFF, at most 2^-24 of the sum per splat.
 * Transmittance: 0 <= T - T' <= eps. */
#include <string.h>

#include "frame/stages.h"

enum { GROUP = 16, MOST_GROUPS = 256 / GROUP };

/* A cluster that has been read and has members left to draw. */
typedef struct active_cluster {
  int64_t view;                  /* index in the frame's clusters */
  bool fresh;                    /* not projected yet */
  uint16_t shaded;               /* bit g: group g has its colours and tiles */
  uint16_t waiting[MOST_GROUPS]; /* per group: members neither drawn nor hidden so far */
  uint16_t ready[MOST_GROUPS];   /* per group: members to be drawn now */
  int32_t ready_count, waiting_count, hidden_count, shaded_count;
  int64_t place; /* index of its first member in the frame's list of drawn Gaussians */
} active_cluster;

typedef struct slabs {
  pags_frame *frame;
  pags_touch_fn *touch;
  void *user;
  depth_key *order;   /* clusters by the bound of their keys */
  int64_t next;       /* in that order */
  uint64_t *taken;    /* bit by bit, per cluster: taken into this slab */
  int64_t dense_next; /* where the next cluster's members go */
  active_cluster *active;
  int64_t active_count;
  pags_reach *reaches; /* per dense index */
  uint32_t limit;      /* keys below are drawn in this slab */
} slabs;

/* Whether the reach holds a block that can still change. */
static bool is_open(const saturation *f, pags_reach r) {
  if (r.x0 >= r.x1)
    return false;
  const int first = r.x0 >> 6, last = (r.x1 - 1) >> 6;
  const uint64_t left = UINT64_MAX << (r.x0 & 63), right = UINT64_MAX >> (63 - ((r.x1 - 1) & 63));
  for (int y = r.y0; y < r.y1; y++) {
    const uint64_t *const row = f->open + (int64_t)y * f->words;
    for (int w = first; w <= last; w++)
      if (row[w] & (w == first ? left : UINT64_MAX) & (w == last ? right : UINT64_MAX))
        return true;
  }
  return false;
}

static uint32_t bits_of(float z) {
  uint32_t bits;
  memcpy(&bits, &z, sizeof bits);
  return bits;
}

static pags_result order_clusters(slabs *s) {
  pags_frame *const f = s->frame;
  s->order = pags_frame_alloc(f, f->cluster_count, sizeof *s->order, "cluster order");
  depth_key *const spare = pags_frame_alloc(f, f->cluster_count, sizeof *spare, "cluster order");
  if (!s->order || !spare)
    return PAGS_ERROR_MEMORY;
  for (int64_t i = 0; i < f->cluster_count; i++)
    s->order[i] = (depth_key){bits_of(f->bounds[i].near), (uint32_t)i};
  s->order = pags_frame_sort_keys(s->order, spare, f->cluster_count);
  return PAGS_OK;
}

static pags_result begin(slabs *s) {
  pags_frame *const f = s->frame;
  PAGS_TRY(pags_frame_saturation_begin(f));
  PAGS_TRY(order_clusters(s));
  const int64_t words = f->cluster_count / 64 + 1;
  s->taken = pags_frame_alloc(f, words, sizeof *s->taken, "cluster flags");
  if (!s->taken)
    return PAGS_ERROR_MEMORY;
  memset(s->taken, 0, (size_t)words * sizeof *s->taken);
  s->active = pags_frame_alloc(f, f->cluster_count, sizeof *s->active, "clusters at work");
  s->reaches = pags_frame_alloc(f, f->dense_count, sizeof *s->reaches, "reaches");
  f->splats = pags_frame_alloc(f, f->dense_count, sizeof *f->splats, "projected Gaussians");
  f->keys = pags_frame_alloc(f, f->dense_count, sizeof *f->keys, "depth keys");
  f->boxes = pags_frame_alloc(f, f->dense_count, sizeof *f->boxes, "tiles of Gaussians");
  return s->active && s->reaches && f->splats && f->keys && f->boxes ? PAGS_OK : PAGS_ERROR_MEMORY;
}

/* Those marked become active in the order in which they lie in memory, which is how they will be read; so do their
 * members in the dense arrays. */
static void activate_taken(slabs *s) {
  pags_frame *const f = s->frame;
  for (int64_t word = 0; word * 64 < f->cluster_count; word++) {
    for (uint64_t bits = s->taken[word]; bits; bits &= bits - 1) {
      const int64_t i = word * 64 + __builtin_ctzll(bits);
      f->clusters[i].base = s->dense_next;
      s->dense_next += (f->clusters[i].count + GROUP - 1) / GROUP * GROUP;
      s->active[s->active_count++] = (active_cluster){.view = i, .fresh = true};
    }
    s->taken[word] = 0;
  }
}

/* Takes clusters until `budget` Gaussians are together, leaving out those that are hidden. */
static void take_clusters(slabs *s, int64_t budget) {
  pags_frame *const f = s->frame;
  int64_t taken = 0;
  for (; s->next < f->cluster_count && taken < budget; s->next++) {
    const int64_t i = s->order[s->next].index;
    if (!is_open(f->full, f->bounds[i].reach)) {
      f->stats.clusters_hidden++;
      continue;
    }
    s->taken[i / 64] |= UINT64_C(1) << i % 64;
    taken += f->clusters[i].count;
  }
  activate_taken(s);
  f->stats.loaded += taken;
  f->last_slab = s->next == f->cluster_count;
  s->limit = f->last_slab ? UINT32_MAX : s->order[s->next].key;
}

/* Finds out which members of a cluster are drawn in this slab. Those that are hidden are forgotten. */
static void choose_members(const slabs *s, active_cluster *a) {
  const pags_frame *const f = s->frame;
  const view_cluster *const c = f->clusters + a->view;
  uint32_t *const keys = f->keys + c->base;
  a->ready_count = a->waiting_count = a->hidden_count = 0;
  for (int first = 0; first < c->count; first += GROUP) {
    unsigned ready = 0, later = 0;
    for (unsigned waiting = a->waiting[first / GROUP]; waiting; waiting &= waiting - 1) {
      const int k = first + __builtin_ctz(waiting);
      if (keys[k] >= s->limit) {
        later |= 1u << (k - first);
        a->waiting_count++;
      } else if (is_open(f->full, s->reaches[c->base + k])) {
        ready |= 1u << (k - first);
        a->ready_count++;
      } else {
        keys[k] = UINT32_MAX;
        a->hidden_count++;
      }
    }
    a->ready[first / GROUP] = (uint16_t)ready;
    a->waiting[first / GROUP] = (uint16_t)later;
  }
}

static void project_fresh(const slabs *s, active_cluster *a) {
  const pags_frame *const f = s->frame;
  const view_cluster *const c = f->clusters + a->view;
  pags_frame_project_cluster(f, c, s->reaches + c->base);
  for (int k = 0; k < c->count; k++)
    if (f->keys[c->base + k] != UINT32_MAX)
      a->waiting[k / GROUP] = (uint16_t)(a->waiting[k / GROUP] | 1u << k % GROUP);
  a->fresh = false;
}

static void project_active(void *context, int64_t begin, int64_t end, int worker) {
  const slabs *const s = context;
  const pags_frame *const f = s->frame;
  for (int64_t i = begin; i < end; i++) {
    active_cluster *const a = s->active + i;
    const view_cluster *const c = f->clusters + a->view;
    if (a->fresh && s->touch)
      s->touch(s->user, c->part, c->cluster, worker);
    if (a->fresh)
      project_fresh(s, a);
    choose_members(s, a);
  }
}

/* Colours and tiles of the groups that have a member to be drawn, once. The other members of a group share its
 * vector and cost nothing. */
static void shade_groups(const slabs *s, active_cluster *a) {
  const pags_frame *const f = s->frame;
  const view_cluster *const c = f->clusters + a->view;
  const pags_part *const part = f->parts + c->part;
  const pags_projection view = pags_frame_shading(f, c);
  const float *rows = NULL;
  row_scratch scratch;
  int64_t stride = 0;
  for (int first = 0; first < c->count; first += GROUP) {
    const int group = first / GROUP, count = c->count - first < GROUP ? c->count - first : GROUP;
    if (!a->ready[group] || (a->shaded >> group & 1))
      continue;
    if (!rows)
      rows = pags_frame_colours(part, c, view.sh_degree, &scratch, &stride);
    const uint32_t *const keys = f->keys + c->base + first;
    f->kernels->shade(&view, rows + first, stride, part->dc ? part->dc + c->first + first : NULL, count, keys,
                      f->splats + c->base + first);
    pags_frame_box_members(f, c->base + first, count);
    a->shaded = (uint16_t)(a->shaded | 1u << group);
    for (int k = 0; k < count; k++)
      a->shaded_count += keys[k] != UINT32_MAX;
  }
}

static void shade_active(void *context, int64_t begin, int64_t end, int worker) {
  const slabs *const s = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++)
    if (s->active[i].ready_count) {
      shade_groups(s, s->active + i);

      /* List ready. */
      const active_cluster *a = s->active + i;
      const view_cluster *const c = s->frame->clusters + a->view;
      uint32_t *out = s->frame->drawn + a->place;
      for (int first = 0; first < c->count; first += GROUP)
        for (unsigned ready = a->ready[first / GROUP]; ready; ready &= ready - 1)
          *out++ = (uint32_t)(c->base + first + __builtin_ctz(ready));
    }
}

static pags_result select_and_shade(slabs *s) {
  pags_frame *const f = s->frame;
  const double t0 = pags_clock_ms();
  PAGS_TRY(pags_frame_for(f, s->active_count, 8, project_active, s));
  f->drawn_count = 0;
  for (int64_t i = 0; i < s->active_count; i++) {
    s->active[i].place = f->drawn_count;
    f->drawn_count += s->active[i].ready_count;
    f->stats.hidden += s->active[i].hidden_count;
  }
  f->drawn = pags_frame_alloc(f, f->drawn_count, sizeof *f->drawn, "list of what is drawn");
  if (!f->drawn)
    return PAGS_ERROR_MEMORY;
  const double t1 = pags_clock_ms();
  PAGS_TRY(pags_frame_for(f, s->active_count, 8, shade_active, s));

  /* Forgets clusters with nothing left to draw. */
  int64_t kept = 0;
  for (int64_t i = 0; i < s->active_count; i++) {
    s->frame->stats.shaded += s->active[i].shaded_count;
    s->active[i].shaded_count = 0;
    if (s->active[i].waiting_count)
      s->active[kept++] = s->active[i];
  }
  s->active_count = kept;

  f->stats.ms_project += t1 - t0;
  f->stats.ms_shade += pags_clock_ms() - t1;
  return PAGS_OK;
}

static pags_result draw_slab(slabs *s, int64_t budget) {
  pags_frame *const f = s->frame;
  pags_frame_stats *const stats = &f->stats;
  const double t0 = pags_clock_ms();
  take_clusters(s, budget);
  stats->ms_occlude += pags_clock_ms() - t0;
  PAGS_TRY(select_and_shade(s));
  const double t1 = pags_clock_ms();
  PAGS_TRY(pags_stage_bin(f));
  const double t2 = pags_clock_ms();
  PAGS_TRY(pags_stage_sort(f));
  const double t3 = pags_clock_ms();
  PAGS_TRY(pags_stage_raster(f));
  const double t4 = pags_clock_ms();
  if (!f->last_slab)
    pags_frame_saturation_update(f);
  stats->ms_bin += t2 - t1, stats->ms_sort += t3 - t2, stats->ms_raster += t4 - t3;
  stats->ms_occlude += pags_clock_ms() - t4;
  stats->slabs++;
  return PAGS_OK;
}

/* A quarter of what is likely to be read: most of what is hidden then lies behind a slab that has been drawn. */
static int64_t slab_budget(const pags_frame *f) {
  enum { SLABS = 4, LEAST = 4096 };
  const double read = (1.0 - f->hiding) * (double)f->stats.in_view;
  if (f->options.slab_size > 0)
    return f->options.slab_size;
  return read > SLABS * (double)LEAST ? (int64_t)(read / SLABS) : LEAST;
}

/* The hidden share of the Gaussians that would have been shaded. Clusters that were never read count like the others.
 */
static double hidden_share(const pags_frame_stats *stats) {
  const double passed = (double)(stats->hidden + stats->shaded);
  if (stats->loaded == 0 || passed <= 0.0)
    return 0.0;
  const double unread = (double)(stats->in_view - stats->loaded) * passed / (double)stats->loaded;
  return ((double)stats->hidden + unread) / (passed + unread);
}

pags_result pags_frame_early_z_slabs(pags_frame *frame, pags_touch_fn *touch, void *user) {
  slabs s = {.frame = frame, .touch = touch, .user = user};
  const pags_frame_stats *const stats = &frame->stats;
  const double t0 = pags_clock_ms();
  PAGS_TRY(begin(&s));
  frame->stats.ms_occlude = pags_clock_ms() - t0;
  const int64_t budget = slab_budget(frame);
  do {
    const pags_arena_mark mark = pags_arena_save(frame->arena);
    PAGS_TRY(draw_slab(&s, budget));
    pags_arena_release(frame->arena, mark);
  } while (!frame->last_slab && frame->full->tiles_full < stats->tiles);
  frame->stats.tiles_full = frame->full->tiles_full;
  frame->stats.clusters_hidden += frame->cluster_count - s.next; /* never came up */
  for (int64_t i = 0; i < s.active_count; i++)
    frame->stats.hidden += s.active[i].waiting_count;
  frame->hiding = hidden_share(stats);
  return PAGS_OK;
}
