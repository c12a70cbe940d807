/* SPDX-License-Identifier: Apache-2.0 */
/* Tests parallel loops and background jobs: each index runs once; nested loops, cancellation, jobs during loops, and
 * threads of a host application. */
#include <pags/tasks.h>

#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

/* cmocka's assertions may only fail on the test's thread: other threads count faults, which are asserted later. */
typedef struct visit {
  int64_t count, grain;
  int workers;
  atomic_int *visits; /* how often each of the `count` indices ran */
  atomic_int faults;  /* number of blocks or worker numbers that were out of range */
} visit;

static void visit_block(void *context, int64_t begin, int64_t end, int worker) {
  visit *v = context;
  bool right_end = end == begin + v->grain || (end == v->count && end - begin < v->grain);
  if (begin % v->grain != 0 || begin >= end || !right_end || worker < 0 || worker >= v->workers)
    atomic_fetch_add(&v->faults, 1);
  for (int64_t i = begin; i < end; i++)
    atomic_fetch_add(&v->visits[i], 1);
}

static void visit_all(pags_tasks *tasks, int64_t count, int64_t grain) {
  visit v = {.count = count, .grain = grain, .workers = pags_tasks_workers(tasks)};
  v.visits = calloc((size_t)count + 1, sizeof *v.visits);
  assert_non_null(v.visits);
  assert_true(pags_parallel_for(tasks, count, grain, visit_block, &v));
  assert_int_equal(atomic_load(&v.faults), 0);
  for (int64_t i = 0; i < count; i++)
    assert_int_equal(atomic_load(&v.visits[i]), 1);
  free(v.visits);
}

static void visit_many_shapes(pags_tasks *tasks) {
  static const int64_t counts[] = {0, 1, 2, 3, 7, 64, 1000, 4097};
  static const int64_t grains[] = {1, 2, 3, 16, 1000, 5000, INT64_MAX};
  for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
    for (size_t g = 0; g < sizeof grains / sizeof *grains; g++)
      visit_all(tasks, counts[c], grains[g]);
}

static void every_index_once(void **state) {
  (void)state;
  static const int threads[] = {1, 2, 3, 4, 8, 17, 0};
  for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
    pags_tasks *tasks = pags_tasks_create(threads[t]);
    assert_non_null(tasks);
    assert_int_equal(pags_tasks_workers(tasks), threads[t] ? threads[t] : pags_available_threads());
    visit_many_shapes(tasks);
    pags_tasks_destroy(tasks);
  }
}

typedef struct edges {
  int64_t first_begin, last_end;
} edges;

static void note_edges(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  edges *e = context;
  if (begin == 0)
    e->first_begin = begin;
  else
    e->last_end = end;
}

static void largest_count_does_not_overflow(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(2);
  edges e = {-1, -1};
  assert_true(pags_parallel_for(tasks, INT64_MAX, INT64_MAX / 2 + 1, note_edges, &e));
  assert_int_equal(e.first_begin, 0);
  assert_true(e.last_end == INT64_MAX);
  pags_tasks_destroy(tasks);
}

static void sum_indices(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  /* One sum per block of 64, not atomic: the end of the loop must make them visible to the caller. */
  int64_t *partials = context;
  int64_t sum = 0;
  for (int64_t i = begin; i < end; i++)
    sum += i;
  partials[begin / 64] = sum;
}

static void ten_thousand_tiny_loops(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(4);
  int64_t partials[8];
  for (int64_t round = 0; round < 10000; round++) {
    int64_t count = 65 + round % 448;
    assert_true(pags_parallel_for(tasks, count, 64, sum_indices, partials));
    int64_t sum = 0;
    for (int64_t b = 0; b < (count + 63) / 64; b++)
      sum += partials[b];
    assert_int_equal(sum, count * (count - 1) / 2);
    /* Sometimes a pause is long enough for the workers to fall asleep, and some pauses end just as they do. */
    if (round % 100 == 0)
      nanosleep(&(struct timespec){.tv_nsec = (long)(30000 + round * 7)}, NULL);
  }
  pags_tasks_destroy(tasks);
}

/* ---- Nesting ---- */

typedef struct nest {
  pags_tasks *tasks, *other;
  atomic_int inner, faults;
} nest;

typedef struct inner_place {
  nest *outer;
  int worker;
} inner_place;

static void inner_block(void *context, int64_t begin, int64_t end, int worker) {
  inner_place *p = context;
  if (worker != p->worker)
    atomic_fetch_add(&p->outer->faults, 1);
  atomic_fetch_add(&p->outer->inner, (int)(end - begin));
}

static void outer_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)begin, (void)end;
  nest *n = context;
  inner_place p = {n, worker};
  if (!pags_parallel_for(n->tasks, 100, 7, inner_block, &p))
    atomic_fetch_add(&n->faults, 1);
}

static void nested_loops_run_inline(void **state) {
  (void)state;
  for (int threads = 1; threads <= 4; threads++) {
    nest n = {.tasks = pags_tasks_create(threads)};
    assert_true(pags_parallel_for(n.tasks, 200, 1, outer_block, &n));
    assert_int_equal(atomic_load(&n.faults), 0);
    assert_int_equal(atomic_load(&n.inner), 200 * 100);
    pags_tasks_destroy(n.tasks);
  }
}

static void back_again_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)begin, (void)end, (void)worker;
  nest *n = context;
  inner_place p = {n, 0}; /* the outermost loop has one block, so it runs as worker 0 */
  pags_parallel_for(n->tasks, 10, 1, inner_block, &p);
}

static void through_other_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)begin, (void)end, (void)worker;
  nest *n = context;
  pags_parallel_for(n->other, 1, 1, back_again_block, n);
}

static void nesting_is_known_through_another_pool(void **state) {
  (void)state;
  nest n = {.tasks = pags_tasks_create(2), .other = pags_tasks_create(2)};
  assert_true(pags_parallel_for(n.tasks, 1, 1, through_other_block, &n));
  assert_int_equal(atomic_load(&n.inner), 10);
  assert_int_equal(atomic_load(&n.faults), 0);
  pags_tasks_destroy(n.tasks);
  pags_tasks_destroy(n.other);
}

/* ---- Cancellation ---- */

typedef struct stop {
  pags_tasks *tasks;
  int64_t at;
  atomic_int done;
  atomic_int begun;
} stop;

static void cancelling_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)end, (void)worker;
  stop *s = context;
  atomic_fetch_add(&s->done, 1);
  if (begin == s->at)
    pags_tasks_cancel(s->tasks);
}

static void a_block_can_cancel(void **state) {
  (void)state;
  for (int threads = 1; threads <= 4; threads++) {
    stop s = {.tasks = pags_tasks_create(threads), .at = 50};
    assert_false(pags_parallel_for(s.tasks, 1000000, 1, cancelling_block, &s));
    assert_true(atomic_load(&s.done) >= 51 - threads && atomic_load(&s.done) < 1000000);
    assert_true(pags_tasks_cancelled(s.tasks));
    atomic_store(&s.done, 0);
    assert_false(pags_parallel_for(s.tasks, 1000, 1, cancelling_block, &s));
    assert_int_equal(atomic_load(&s.done), 0);
    pags_tasks_reset(s.tasks);
    s.at = -1;
    assert_true(pags_parallel_for(s.tasks, 1000, 1, cancelling_block, &s));
    assert_int_equal(atomic_load(&s.done), 1000);
    pags_tasks_destroy(s.tasks);
  }
}

static void slow_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)begin, (void)end, (void)worker;
  stop *s = context;
  atomic_store(&s->begun, 1);
  atomic_fetch_add(&s->done, 1);
  nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
}

static void *cancel_once_begun(void *argument) {
  stop *s = argument;
  while (!atomic_load(&s->begun))
    nanosleep(&(struct timespec){.tv_nsec = 10000}, NULL);
  pags_tasks_cancel(s->tasks);
  return NULL;
}

static void another_thread_can_cancel(void **state) {
  (void)state;
  stop s = {.tasks = pags_tasks_create(2)};
  pthread_t thread;
  assert_int_equal(pthread_create(&thread, NULL, cancel_once_begun, &s), 0);
  assert_false(pags_parallel_for(s.tasks, 1000000, 1, slow_block, &s));
  assert_true(atomic_load(&s.done) < 1000000);
  pthread_join(thread, NULL);
  pags_tasks_destroy(s.tasks);
}

/* ---- Jobs ---- */

typedef struct work {
  pags_job job;
  pags_tasks *tasks;
  int value;        /* not atomic: waiting for the job must make it visible */
  atomic_int *gate; /* the job waits for this flag, if there is one */
  atomic_int *begun;
} work;

static void run_work(void *context) {
  work *w = context;
  if (w->begun)
    atomic_fetch_add(w->begun, 1);
  while (w->gate && !atomic_load(w->gate))
    nanosleep(&(struct timespec){.tv_nsec = 10000}, NULL);
  w->value += 1;
}

static void jobs_run_on_any_number_of_threads(void **state) {
  (void)state;
  for (int threads = 1; threads <= 3; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    work works[50] = {0};
    for (int round = 1; round <= 20; round++) {
      for (int i = 0; i < 50; i++) {
        works[i].job.run = run_work;
        works[i].job.context = &works[i];
        pags_job_submit(tasks, &works[i].job);
      }
      for (int i = 0; i < 50; i++) {
        /* Waits for the jobs out of order, so that some are taken from the middle of the queue. */
        int k = (i * 7 + round) % 50;
        pags_job_wait(tasks, &works[k].job);
        assert_int_equal(works[k].value, round);
        pags_job_wait(tasks, &works[k].job); /* waiting again returns at once */
        assert_int_equal(works[k].value, round);
      }
    }
    pags_tasks_destroy(tasks);
  }
}

static void waiting_for_an_unsubmitted_job_returns(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(2);
  work w = {.job = {.run = run_work, .context = &w}};
  pags_job_wait(tasks, &w.job);
  assert_int_equal(w.value, 0);
  pags_tasks_destroy(tasks);
}

static void a_loop_does_not_wait_for_a_running_job(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(2);
  atomic_int gate = 0, begun = 0;
  work w = {.job = {.run = run_work, .context = &w}, .gate = &gate, .begun = &begun};
  pags_job_submit(tasks, &w.job);
  while (!atomic_load(&begun))
    nanosleep(&(struct timespec){.tv_nsec = 10000}, NULL);
  /* This call would never return if a loop waited for the blocked job, whose gate opens only below. */
  for (int i = 0; i < 100; i++)
    visit_all(tasks, 1000, 3);
  atomic_store(&gate, 1);
  pags_job_wait(tasks, &w.job);
  assert_int_equal(w.value, 1);
  pags_tasks_destroy(tasks);
}

static void jobs_and_loops_share_the_workers(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(3);
  work works[8] = {0};
  for (int round = 1; round <= 300; round++) {
    for (int i = 0; i < 8; i++) {
      works[i].job.run = run_work;
      works[i].job.context = &works[i];
      pags_job_submit(tasks, &works[i].job);
    }
    visit_all(tasks, 200, 3);
    for (int i = 0; i < 8; i++) {
      pags_job_wait(tasks, &works[i].job);
      assert_int_equal(works[i].value, round);
    }
  }
  pags_tasks_destroy(tasks);
}

static void looping_work(void *context) {
  work *w = context;
  nest n = {.tasks = w->tasks};
  pags_parallel_for(w->tasks, 10, 1, outer_block, &n);
  w->value = atomic_load(&n.faults) ? -1 : atomic_load(&n.inner);
}

static void a_job_may_run_loops(void **state) {
  (void)state;
  for (int threads = 1; threads <= 3; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    for (int round = 0; round < 50; round++) {
      work w = {.job = {.run = looping_work, .context = &w}, .tasks = tasks};
      pags_job_submit(tasks, &w.job);
      visit_all(tasks, 100, 3);
      pags_job_wait(tasks, &w.job);
      assert_int_equal(w.value, 1000);
    }
    pags_tasks_destroy(tasks);
  }
}

static void destroy_finishes_pending_jobs(void **state) {
  (void)state;
  for (int threads = 1; threads <= 3; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    work works[100] = {0};
    for (int i = 0; i < 100; i++) {
      works[i].job.run = run_work;
      works[i].job.context = &works[i];
      pags_job_submit(tasks, &works[i].job);
    }
    pags_tasks_destroy(tasks);
    for (int i = 0; i < 100; i++)
      assert_int_equal(works[i].value, 1);
  }
}

/* ---- Threads of a host application ---- */

typedef struct host_call {
  void (*entry)(void *argument, int worker);
  void *argument;
  int worker;
} host_call;

static void *host_thread(void *argument) {
  host_call *call = argument;
  call->entry(call->argument, call->worker);
  return NULL;
}

static void host_with_threads(void *user, void (*entry)(void *argument, int worker), void *argument) {
  pthread_t threads[4];
  host_call calls[4];
  int *runs = user;
  ++*runs;
  for (int i = 0; i < 4; i++) {
    calls[i] = (host_call){entry, argument, i};
    if (pthread_create(&threads[i], NULL, host_thread, &calls[i]) != 0)
      abort();
  }
  for (int i = 0; i < 4; i++)
    pthread_join(threads[i], NULL);
}

/* A host that has fewer threads than it states and runs its workers one after the other, in any order. */
static void host_in_turn(void *user, void (*entry)(void *argument, int worker), void *argument) {
  int *runs = user;
  ++*runs;
  for (int i = 3; i >= 0; i--)
    entry(argument, i);
}

static void a_host_can_run_loops(void **state) {
  (void)state;
  int runs = 0;
  pags_runner runners[] = {{&runs, 4, host_with_threads}, {&runs, 4, host_in_turn}};
  for (size_t i = 0; i < sizeof runners / sizeof *runners; i++) {
    runs = 0;
    pags_tasks *tasks = pags_tasks_create_with_runner(&runners[i]);
    assert_non_null(tasks);
    assert_int_equal(pags_tasks_workers(tasks), 4);
    visit_many_shapes(tasks);
    assert_true(runs > 10);
    nest n = {.tasks = tasks};
    assert_true(pags_parallel_for(tasks, 20, 1, outer_block, &n));
    assert_int_equal(atomic_load(&n.faults), 0);
    assert_int_equal(atomic_load(&n.inner), 20 * 100);
    work w = {.job = {.run = run_work, .context = &w}};
    pags_job_submit(tasks, &w.job);
    pags_job_wait(tasks, &w.job);
    assert_int_equal(w.value, 1);
    pags_tasks_destroy(tasks);
  }
}

/* ---- The workers' arenas ---- */

static void use_arena(void *context, int64_t begin, int64_t end, int worker) {
  pags_tasks *tasks = context;
  pags_arena *arena = pags_tasks_arena(tasks, worker);
  pags_arena_mark mark = pags_arena_save(arena);
  unsigned char *scratch = pags_arena_alloc(arena, (size_t)(end - begin), 1000);
  if (scratch)
    memset(scratch, worker, (size_t)(end - begin) * 1000);
  pags_arena_release(arena, mark);
}

static void each_worker_has_an_arena(void **state) {
  (void)state;
  pags_tasks *tasks = pags_tasks_create(3);
  for (int round = 0; round < 100; round++)
    assert_true(pags_parallel_for(tasks, 100, 9, use_arena, tasks));
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < i; j++)
      assert_ptr_not_equal(pags_tasks_arena(tasks, i), pags_tasks_arena(tasks, j));
  pags_tasks_destroy(tasks);
}

/* ---- More workers than processors ---- */

static void nap_block(void *context, int64_t begin, int64_t end, int worker) {
  atomic_int *seen = context;
  (void)begin, (void)end;
  atomic_store(&seen[worker], 1);
  nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
}

/* As many workers are awake as there are processors: blocks that sleep would leave room for all workers if these
 * were awake. */
static void as_many_workers_are_awake_as_there_are_processors(void **state) {
  enum { LOOPS = 50, MORE = 12 };
  const int processors = pags_available_threads(), workers = processors + MORE;
  int64_t sum = 0;
  (void)state;
  pags_tasks *tasks = pags_tasks_create(workers);
  atomic_int *seen = calloc((size_t)workers, sizeof *seen);
  assert_true(tasks && seen);
  nanosleep(&(struct timespec){.tv_nsec = 30000000}, NULL); /* until the workers sleep */
  for (int i = 0; i < LOOPS; i++) {
    for (int w = 0; w < workers; w++)
      atomic_store(&seen[w], 0);
    assert_true(pags_parallel_for(tasks, 4 * workers, 1, nap_block, seen));
    for (int w = 0; w < workers; w++)
      sum += atomic_load(&seen[w]);
  }
  /* One more worker may be awake for a moment, if it was woken for a loop that ends before it starts. */
  assert_in_range(sum, LOOPS, LOOPS * (processors + 3));
  free(seen);
  pags_tasks_destroy(tasks);
}

static void destroying_nothing_is_allowed(void **state) {
  (void)state;
  pags_tasks_destroy(NULL);
  pags_arena_destroy(NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_index_once),
      cmocka_unit_test(largest_count_does_not_overflow),
      cmocka_unit_test(ten_thousand_tiny_loops),
      cmocka_unit_test(nested_loops_run_inline),
      cmocka_unit_test(nesting_is_known_through_another_pool),
      cmocka_unit_test(a_block_can_cancel),
      cmocka_unit_test(another_thread_can_cancel),
      cmocka_unit_test(jobs_run_on_any_number_of_threads),
      cmocka_unit_test(waiting_for_an_unsubmitted_job_returns),
      cmocka_unit_test(a_loop_does_not_wait_for_a_running_job),
      cmocka_unit_test(jobs_and_loops_share_the_workers),
      cmocka_unit_test(a_job_may_run_loops),
      cmocka_unit_test(destroy_finishes_pending_jobs),
      cmocka_unit_test(a_host_can_run_loops),
      cmocka_unit_test(each_worker_has_an_arena),
      cmocka_unit_test(as_many_workers_are_awake_as_there_are_processors),
      cmocka_unit_test(destroying_nothing_is_allowed),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
