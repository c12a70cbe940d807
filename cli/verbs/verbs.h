/* SPDX-License-Identifier: Apache-2.0 */
/* The verbs of pags: each takes its arguments (without program and verb) and returns the exit code. */
#ifndef PAGS_CLI_VERBS_H
#define PAGS_CLI_VERBS_H

int pags_verb_train(int argc, char **argv);
int pags_verb_render(int argc, char **argv);
int pags_verb_eval(int argc, char **argv);
int pags_verb_export(int argc, char **argv);
int pags_verb_info(int argc, char **argv);
int pags_verb_import(int argc, char **argv);
int pags_verb_synth(int argc, char **argv);
int pags_verb_split(int argc, char **argv);
int pags_verb_merge(int argc, char **argv);
int pags_verb_report(int argc, char **argv);
int pags_verb_view(int argc, char **argv);

#endif
