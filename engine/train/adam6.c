/* SPDX-License-Identifier: Apache-2.0 */
/* One Adam step (Kingma and Ba 2015) on a parameter of six numbers, in double. */
#include "train/adam6.h"

#include <math.h>
#include <stdbool.h>

#include "maths/maths.h"

bool pags_adam6_step(pags_adam6 *m, const double gradient[6], const pags_train_config *c, double step[6]) {
  for (int i = 0; i < 6; i++)
    if (!(fabs(gradient[i]) < 1e150)) /* below this the square is finite, too; the test is false for NaN */
      return false;
  m->count++;
  const double bias1 = 1.0 - pags_pow(c->optimiser.beta1, (double)m->count),
               bias2 = 1.0 - pags_pow(c->optimiser.beta2, (double)m->count);
  for (int i = 0; i < 6; i++) {
    m->first[i] = c->optimiser.beta1 * m->first[i] + (1.0 - c->optimiser.beta1) * gradient[i];
    m->second[i] = c->optimiser.beta2 * m->second[i] + (1.0 - c->optimiser.beta2) * gradient[i] * gradient[i];
    step[i] = m->first[i] / bias1 / (sqrt(m->second[i] / bias2) + 1e-15);
  }
  return true;
}
