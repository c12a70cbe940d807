/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the JSON reader and writer. */
#include "base/json.h"

#include <locale.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "scratch_folder.h"

#include <cmocka.h>

static pags_json *parse(const char *text) {
  pags_json *json;
  assert_int_equal(pags_json_parse_text("a.json", text, strlen(text), &json), PAGS_OK);
  return json;
}

static void assert_fails(const char *text, const char *message) {
  pags_json *json;
  assert_int_not_equal(pags_json_parse_text("a.json", text, strlen(text), &json), PAGS_OK);
  assert_null(json);
  assert_string_equal(pags_error_message(), message);
}

static void values_know_type_and_line(void **state) {
  (void)state;
  pags_json *json = parse("{\n \"a\": [1, -2.5e3,\n true, null],\n \"b\": {\"c\": \"x\"}\n}\n");
  const pags_json_value *root = pags_json_root(json), *a = pags_json_member(root, "a");
  assert_int_equal(root->type, PAGS_JSON_OBJECT);
  assert_int_equal(root->count, 2);
  assert_int_equal(a->count, 4);
  assert_int_equal(a->line, 2);
  assert_true(a->first->number == 1);
  assert_true(a->first->next->number == -2500);
  assert_int_equal(a->first->next->next->line, 3);
  assert_true(a->first->next->next->boolean);
  assert_int_equal(a->first->next->next->next->type, PAGS_JSON_NULL);
  const pags_json_value *b = pags_json_member(root, "b");
  assert_string_equal(pags_json_member(b, "c")->text, "x");
  assert_memory_equal(b->source_begin, "{\"c\": \"x\"}", (size_t)(b->source_end - b->source_begin));
  assert_null(pags_json_member(root, "c"));
  pags_json_destroy(json);
}

static void syntax_errors_name_the_line(void **state) {
  (void)state;
  assert_fails("", "a.json:1: expected a value, found the end of the file");
  assert_fails("{\n\"a\" 1}", "a.json:2: expected ':', found '1'");
  assert_fails("[1\n,\n]", "a.json:3: expected a value, found ']'");
  assert_fails("[1 2]", "a.json:1: expected ',' or ']', found '2'");
  assert_fails("{\"a\": NaN}",
               "a.json:1: expected a number for a, found NaN, which JSON doesn't have (Python's json.dump writes it); "
               "leave out what isn't known");
  assert_fails("{\"a\": {\"7\": [[0], [1,\n-Infinity]]}}",
               "a.json:2: expected a number for a.7[1][1], found -Infinity, which JSON doesn't have (Python's "
               "json.dump writes it); leave out what isn't known");
  assert_fails("{\"a\": Nought}", "a.json:1: expected a value, found 'N'");
  assert_fails("[01]", "a.json:1: expected ',' or ']', found '1'");
  assert_fails("[1.]", "a.json:1: expected a digit after the point, found ']'");
  assert_fails("[1e999]", "a.json:1: the number 1e999 is too large");
  assert_fails("\"a\nb\"", "a.json:1: expected the end of a string, found byte 0x0a");
  assert_fails("\"\\q\"", "a.json:1: expected an escape sequence, found 'q'");
  assert_fails("[] []", "a.json:1: expected the end of the file, found '['");
  assert_fails("\"\\u0000\"", "a.json:1: expected a string without \\u0000 before this, found '\"'");
}

static void nesting_has_a_limit(void **state) {
  (void)state;
  char deep[2001];
  memset(deep, '[', 2000);
  deep[2000] = 0;
  assert_fails(deep, "a.json:1: nested deeper than 128 levels");
}

static void every_truncation_fails_cleanly(void **state) {
  (void)state;
  const char *text = "{\"a\": [1.5e-3, \"\\u00e9\\ud83d\\ude00\", true, {\"b\": null}], \"c\": -0}";
  for (size_t size = 0; size < strlen(text); size++) {
    pags_json *json;
    assert_int_equal(pags_json_parse_text("a.json", text, size, &json), PAGS_ERROR_FORMAT);
  }
}

static void strings_are_decoded(void **state) {
  (void)state;
  pags_json *json = parse("\xEF\xBB\xBF[\"\\u00e9\\ud83d\\ude00\\n\\\"\\/\", \"\xC3\xA9\"]");
  assert_string_equal(pags_json_root(json)->first->text, "\xC3\xA9\xF0\x9F\x98\x80\n\"/");
  assert_string_equal(pags_json_root(json)->first->next->text, "\xC3\xA9");
  pags_json_destroy(json);
}

/* File names may have any bytes but zero and the slash. The written JSON must be UTF-8, and reading must give the
 * same bytes. */
static void bytes_that_are_not_utf8_read_back(void **state) {
  (void)state;
  static const char *const texts[] = {
      "stra\xDF"
      "e",
      "\xC3\xA9\xDF",
      "\xC0\xAF",
      "\xED\xA0\x80",
      "\xF4\x90\x80\x80",
      "\xF0\x9F\x98\x80\xF0\x9F\x98",
      "\x80\xFF",
      "\xE2\x82"};
  static const char *const written[] = {"stra\\udcdfe",
                                        "\xC3\xA9\\udcdf",
                                        "\\udcc0\\udcaf",
                                        "\\udced\\udca0\\udc80",
                                        "\\udcf4\\udc90\\udc80\\udc80",
                                        "\xF0\x9F\x98\x80\\udcf0\\udc9f\\udc98",
                                        "\\udc80\\udcff",
                                        "\\udce2\\udc82"};
  for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
    pags_json_writer w;
    char raw[64], expected[256];
    snprintf(raw, sizeof raw, "\"%s\"", texts[i]);
    snprintf(expected, sizeof expected, "{\"%s\": \"%s\", \"raw\": \"%s\"}\n", written[i], written[i], written[i]);
    pags_json_writer_init(&w, 0);
    pags_json_begin_object(&w, NULL);
    pags_json_put_string(&w, texts[i], texts[i]);
    pags_json_put_raw(&w, "raw", raw);
    pags_json_end_object(&w);
    assert_int_equal(pags_json_writer_finish(&w), PAGS_OK);
    assert_string_equal(w.data, expected);
    pags_json *json = parse(w.data);
    assert_string_equal(pags_json_root(json)->first->text, texts[i]);
    assert_string_equal(pags_json_root(json)->first->key, texts[i]);
    assert_string_equal(pags_json_root(json)->first->next->text, texts[i]);
    pags_json_destroy(json);
    pags_json_writer_destroy(&w);
  }
  char *const readable = pags_text_readable(
      "stra\xDF"
      "e \xC3\xA9");
  assert_string_equal(readable, "stra\\xDFe \xC3\xA9");
  free(readable);
}

static void getters_name_key_and_line(void **state) {
  (void)state;
  pags_json *json =
      parse("{\"x\": 1,\n\"x\": 2,\n\"s\": \"t\",\n\"n\": null,\n\"i\": 9007199254740993,\n\"m\": [[1, 2], [3, 4]]}");
  const pags_json_value *root = pags_json_root(json);
  double x, m[4];
  int64_t i;
  const char *s;
  assert_int_equal(pags_json_number(json, root, "x", &x), PAGS_OK);
  assert_true(x == 2); /* the last of two equal keys counts */
  assert_int_equal(pags_json_number(json, root, "s", &x), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(), "a.json:3: expected a number for 's', found a string");
  assert_int_equal(pags_json_number(json, root, "fl_x", &x), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(), "a.json:1: expected a number for 'fl_x', which is missing");
  assert_int_equal(pags_json_number_or(json, root, "n", 7, &x), PAGS_OK);
  assert_true(x == 7);
  assert_int_equal(pags_json_number_or(json, root, "s", 7, &x), PAGS_ERROR_FORMAT);
  assert_int_equal(pags_json_integer(json, root, "i", 0, INT64_MAX, &i), PAGS_OK);
  assert_true(i == INT64_C(9007199254740993)); /* 2^53 + 1 isn't a double */
  assert_int_equal(pags_json_integer(json, root, "i", 1, 9, &i), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(),
                      "a.json:5: expected an integer from 1 to 9 for 'i', found 9007199254740993");
  assert_int_equal(pags_json_string_or(json, root, "absent", "d", &s), PAGS_OK);
  assert_string_equal(s, "d");
  assert_int_equal(pags_json_numbers(json, root, "m", 4, m), PAGS_OK);
  assert_true(m[3] == 4);
  assert_int_equal(pags_json_numbers(json, root, "m", 3, m), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(), "a.json:6: expected 3 numbers for 'm', found 4");
  pags_json_destroy(json);
}

static void unsigned_integers_are_exact(void **state) {
  (void)state;
  pags_json *json = parse("{\"big\": 18446744073709551615, \"more\": 18446744073709551616, \"less\": -1, \"f\": 1.0}");
  uint64_t value;
  assert_int_equal(pags_json_unsigned_or(json, pags_json_root(json), "big", 0, &value), PAGS_OK);
  assert_true(value == UINT64_MAX);
  assert_int_equal(pags_json_unsigned_or(json, pags_json_root(json), "more", 0, &value), PAGS_ERROR_FORMAT);
  assert_int_equal(pags_json_unsigned_or(json, pags_json_root(json), "less", 0, &value), PAGS_ERROR_FORMAT);
  assert_int_equal(pags_json_unsigned_or(json, pags_json_root(json), "f", 0, &value), PAGS_ERROR_FORMAT);
  pags_json_destroy(json);
}

static void write_sample(pags_json_writer *w, int indent) {
  pags_json_writer_init(w, indent);
  pags_json_begin_object(w, NULL);
  pags_json_put_number(w, "tenth", 0.1);
  pags_json_put_number(w, "nan", (double)NAN);
  pags_json_put_integer(w, "i", INT64_MIN);
  pags_json_put_unsigned(w, "u", UINT64_MAX);
  pags_json_put_bool(w, "b", true);
  pags_json_put_string(w, "s", "a\"\\\n\x01");
  pags_json_put_string(w, "none", NULL);
  pags_json_put_numbers(w, "v", (double[]){1, 1.0 / 3, -0.0}, 3);
  pags_json_begin_array(w, "a");
  pags_json_begin_object(w, NULL);
  pags_json_end_object(w);
  pags_json_put_raw(w, NULL, "{\"raw\": 1}");
  pags_json_end_array(w);
  pags_json_end_object(w);
  assert_int_equal(pags_json_writer_finish(w), PAGS_OK);
}

static void the_writer_gives_known_text(void **state) {
  (void)state;
  pags_json_writer w;
  write_sample(&w, 0);
  assert_string_equal(w.data,
                      "{\"tenth\": 0.1, \"nan\": null, \"i\": -9223372036854775808, \"u\": 18446744073709551615, "
                      "\"b\": true, \"s\": \"a\\\"\\\\\\n\\u0001\", \"none\": null, "
                      "\"v\": [1, 0.3333333333333333, -0], \"a\": [{}, {\"raw\": 1}]}\n");
  pags_json_writer_destroy(&w);
  write_sample(&w, 2);
  assert_non_null(strstr(w.data, "\n  \"a\": [\n    {},\n    {\"raw\": 1}\n  ]\n}\n"));
  pags_json_destroy(parse(w.data));
  pags_json_writer_destroy(&w);
}

static void doubles_survive(void **state) {
  (void)state;
  uint64_t bits = 0x3FF0000000000001u;
  for (int i = 0; i < 20000; i++) {
    char text[PAGS_DOUBLE_TEXT];
    double value, back;
    bits = bits * 6364136223846793005u + 1442695040888963407u;
    memcpy(&value, &bits, sizeof value);
    if (!isfinite(value))
      continue;
    assert_true((size_t)pags_text_from_double(value, text) == strlen(text));
    back = pags_text_to_double(text, NULL);
    assert_memory_equal(&back, &value, sizeof back);
  }
}

/* A locale with a decimal comma doesn't change how numbers are read and written. Machines without such a locale can't
 * run this test. */
static void the_locale_changes_nothing(void **state) {
  (void)state;
  static const char *const names[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "de_DE", "fr_FR"};
  bool found = false;
  for (size_t i = 0; i < sizeof names / sizeof *names && !found; i++)
    found = setlocale(LC_ALL, names[i]) != NULL;
  if (!found) {
    printf("skipped: needs a locale with a decimal comma, such as de_DE.UTF-8\n");
    skip();
  }
  char text[PAGS_DOUBLE_TEXT];
  pags_text_from_double(0.5, text);
  double back = pags_text_to_double("0.25", NULL);
  setlocale(LC_ALL, "C");
  assert_string_equal(text, "0.5");
  assert_true(back == 0.25);
}

static void files_are_named(void **state) {
  (void)state;
  pags_json *json;
  const char *path = scratch_file("bad.json", "{\n\n?}", 5);
  char message[SCRATCH_PATH + 200];
  snprintf(message, sizeof message, "%s:3: expected a key in quotes, found '?'", path);
  assert_int_equal(pags_json_parse_file(path, &json), PAGS_ERROR_FORMAT);
  assert_string_equal(pags_error_message(), message);
  assert_int_equal(pags_json_parse_file(scratch("none.json"), &json), PAGS_ERROR_IO);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(values_know_type_and_line),      cmocka_unit_test(bytes_that_are_not_utf8_read_back),
      cmocka_unit_test(syntax_errors_name_the_line),    cmocka_unit_test(nesting_has_a_limit),
      cmocka_unit_test(every_truncation_fails_cleanly), cmocka_unit_test(strings_are_decoded),
      cmocka_unit_test(getters_name_key_and_line),      cmocka_unit_test(unsigned_integers_are_exact),
      cmocka_unit_test(the_writer_gives_known_text),    cmocka_unit_test(doubles_survive),
      cmocka_unit_test(the_locale_changes_nothing),     cmocka_unit_test(files_are_named),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
