/* SPDX-License-Identifier: Apache-2.0 */
/* Tests result codes and error messages. */
#include <pags/base.h>

#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

static void a_failure_sets_the_message(void **state) {
  (void)state;
  assert_non_null(pags_error_message());
  assert_int_equal(pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a number", "a.json", 7), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(), "a.json:7: expected a number");
}

static void a_message_may_quote_the_previous_one(void **state) {
  (void)state;
  pags_fail(PAGS_ERROR_IO, "no such file");
  pags_fail(PAGS_ERROR_IO, "scene: %s", pags_error_message());
  assert_string_equal(pags_error_message(), "scene: no such file");
}

static void long_messages_are_cut(void **state) {
  (void)state;
  char text[5000];
  memset(text, 'x', sizeof text - 1);
  text[sizeof text - 1] = '\0';
  pags_fail(PAGS_ERROR_LIMIT, "%s", text);
  assert_int_equal(strlen(pags_error_message()), 1023);
}

static void *fail_elsewhere(void *argument) {
  int *clean = argument;
  *clean = pags_error_message()[0] == '\0';
  pags_fail(PAGS_ERROR_IO, "theirs");
  return NULL;
}

static void threads_do_not_see_each_others_messages(void **state) {
  (void)state;
  pags_fail(PAGS_ERROR_IO, "ours");
  int clean = 0;
  pthread_t thread;
  assert_int_equal(pthread_create(&thread, NULL, fail_elsewhere, &clean), 0);
  pthread_join(thread, NULL);
  assert_true(clean);
  assert_string_equal(pags_error_message(), "ours");
}

static pags_result try_twice(pags_result first, int *reached) {
  PAGS_TRY(first);
  *reached = 1;
  return PAGS_OK;
}

static void try_returns_the_failure(void **state) {
  (void)state;
  int reached = 0;
  assert_int_equal(try_twice(PAGS_ERROR_MEMORY, &reached), PAGS_ERROR_MEMORY);
  assert_int_equal(reached, 0);
  assert_int_equal(try_twice(PAGS_OK, &reached), PAGS_OK);
  assert_int_equal(reached, 1);
}

static void every_code_has_a_distinct_name(void **state) {
  (void)state;
  for (int a = PAGS_OK; a <= PAGS_CANCELLED; a++) {
    assert_string_not_equal(pags_result_name((pags_result)a), "unknown result");
    for (int b = PAGS_OK; b < a; b++)
      assert_string_not_equal(pags_result_name((pags_result)a), pags_result_name((pags_result)b));
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_failure_sets_the_message), cmocka_unit_test(a_message_may_quote_the_previous_one),
      cmocka_unit_test(long_messages_are_cut),      cmocka_unit_test(threads_do_not_see_each_others_messages),
      cmocka_unit_test(try_returns_the_failure),    cmocka_unit_test(every_code_has_a_distinct_name),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
