/* A quadratic cost that is updated row by row with exponential forgetting.
 *
 *     P <- lambda P + (1 - lambda) xi xi',   q <- lambda q + (1 - lambda) xi x,   c <- lambda c + (1 - lambda) x^2 / 2
 *
 * is the mean of the squared errors (v'xi + x)^2 / 2 with exponentially decaying weights; the weight of a row decays to
 * 1/e after 1/(1 - lambda) rows. On a stream of data, solvers get P and q from this update. P stays exactly symmetric.
 *
 * Source: L. Ljung, System Identification, 1999, section 11.2 (forgetting factor).
 */
#include "forgetting.h"

void absorb(real *P, real *q, real *c, int d, const real *row, real forgetting)
{
    const real weight = 1 - forgetting, x = row[d];
    for (int i = 0; i < d; ++i) {
        const real coefficient = weight * row[i];
        for (int j = i; j < d; ++j) {
            P[i * d + j] = P[j * d + i] = forgetting * P[i * d + j] + coefficient * row[j];
        }
        q[i] = forgetting * q[i] + coefficient * x;
    }
    *c = forgetting * *c + weight * x * x / 2;
}
