/* The bound sigma_min(W) / sigma_max(Wt) of a batch, one configuration after the other, on all cores.

   Compiled with -DREAL=double or float and -DCONTACTS=1, 2, 4, 8. The terms are stated by hand: a rod in one or two
   guides, or a chain of CONTACTS - 1 hinged rods with every joint in a guide, all masses and lengths one. Up to two
   contacts by the formulas for one and two singular values; more by the Cholesky factor of the mass matrix, forward
   substitution and one-sided Jacobi rotations until the columns are orthogonal to rounding. */

#include <float.h>
#include <math.h>
#include <tgmath.h>

#define EPS (sizeof(REAL) == 4 ? (REAL)FLT_EPSILON : (REAL)DBL_EPSILON)

#if CONTACTS == 1

static inline REAL bound(REAL theta) {
    REAL s = sin(theta), c = cos(theta);
    return (1 + 3 * c * c) / fabs(3 * s * c);
}

#elif CONTACTS == 2

static inline REAL top(REAL a, REAL b, REAL c, REAL d) {
    REAL p = a * a + c * c, q = b * b + d * d, r = a * b + c * d, h = (REAL)0.5 * (p - q);
    return sqrt((REAL)0.5 * (p + q) + sqrt(h * h + r * r));
}

static inline REAL bound(REAL theta) {
    REAL s = sin(theta), c = cos(theta), square = 3 * c * c, product = 3 * s * c;
    REAL w11 = 1 + square, w12 = 1 - square, w21 = w12, w22 = w11;
    REAL smallest = fabs(w11 * w22 - w12 * w21) / top(w11, w12, w21, w22);
    return smallest / top(-product, product, product, -product);
}

#else

#define RODS (CONTACTS - 1)
#define N (CONTACTS + 1)

static void singular_values(int n, REAL A[][N], REAL *least, REAL *largest) {
    for (int sweep = 0, turned = 1; turned && sweep < 30; sweep++) {
        turned = 0;
        for (int i = 0; i < CONTACTS; i++)
            for (int j = i + 1; j < CONTACTS; j++) {
                REAL aa = 0, ab = 0, bb = 0;
                for (int k = 0; k < n; k++) {
                    aa += A[i][k] * A[i][k], ab += A[i][k] * A[j][k], bb += A[j][k] * A[j][k];
                }
                if (fabs(ab) <= EPS * sqrt(aa * bb)) continue;
                turned = 1;
                REAL z = (bb - aa) / (2 * ab), t = copysign(1 / (fabs(z) + sqrt(1 + z * z)), z);
                REAL c = 1 / sqrt(1 + t * t), s = c * t;
                for (int k = 0; k < n; k++) {
                    REAL x = A[i][k], y = A[j][k];
                    A[i][k] = c * x - s * y, A[j][k] = s * x + c * y;
                }
            }
    }
    *least = INFINITY, *largest = 0;
    for (int i = 0; i < CONTACTS; i++) {
        REAL square = 0;
        for (int k = 0; k < n; k++) square += A[i][k] * A[i][k];
        *least = fmin(*least, sqrt(square)), *largest = fmax(*largest, sqrt(square));
    }
}

static REAL bound(REAL theta) {
    REAL s[RODS], c[RODS], L[N][N] = {{0}}, G[CONTACTS][N] = {{0}}, H[CONTACTS][N] = {{0}}, Y[CONTACTS][N];
    for (int i = 0; i < RODS; i++) {
        REAL angle = theta * (1 - (REAL)i / (2 * RODS));
        s[i] = sin(angle), c[i] = cos(angle);
    }
    L[0][0] = L[1][1] = RODS;
    for (int j = 0; j < RODS; j++) {
        REAL after = RODS - 1 - j;
        L[2 + j][0] = -(after + (REAL)0.5) * s[j], L[2 + j][1] = (after + (REAL)0.5) * c[j];
        L[2 + j][2 + j] = after + (REAL)1 / 3;
        for (int i = 0; i < j; i++) L[2 + j][2 + i] = (after + (REAL)0.5) * (c[i] * c[j] + s[i] * s[j]);
    }
    for (int p = 0; p < CONTACTS; p++) {
        H[p][0] = G[p][1] = 1;
        for (int j = 0; j < p; j++) G[p][2 + j] = c[j], H[p][2 + j] = -s[j];
    }
    for (int j = 0; j < N; j++) {
        for (int k = 0; k < j; k++) L[j][j] -= L[j][k] * L[j][k];
        L[j][j] = sqrt(L[j][j]);
        for (int i = j + 1; i < N; i++) {
            for (int k = 0; k < j; k++) L[i][j] -= L[i][k] * L[j][k];
            L[i][j] /= L[j][j];
        }
    }
    for (int p = 0; p < CONTACTS; p++)
        for (int i = 0; i < N; i++) {
            for (int k = 0; k < i; k++) G[p][i] -= L[i][k] * G[p][k], H[p][i] -= L[i][k] * H[p][k];
            G[p][i] /= L[i][i], H[p][i] /= L[i][i];
        }
    for (int p = 0; p < CONTACTS; p++)
        for (int r = 0; r < CONTACTS; r++) {
            Y[p][r] = 0;
            for (int k = 0; k < N; k++) Y[p][r] += G[r][k] * H[p][k];
        }
    REAL least, largest, unused;
    singular_values(N, G, &least, &unused);
    singular_values(CONTACTS, Y, &unused, &largest);
    return least * least / largest;
}

#endif

void bounds(const REAL *theta, REAL *found, long count) {
#if CONTACTS <= 2
#pragma omp parallel for simd
#else
#pragma omp parallel for
#endif
    for (long i = 0; i < count; i++) found[i] = bound(theta[i]);
}
