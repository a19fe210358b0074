/* The virtual work of one integrand in cells or facets of one kind, and its derivative, LANES cells
   at a time.

   Before this file stand functions of the integrand and
     DIM, CORNERS, NODES     dimension; nodes of the geometry and of the unknown in a cell
     FIELDS                  {nodes, components, kind} of all that the integrand is given
     VALUES, WIDTH           numbers of all fields in a cell, and given at a point
     TEST, TESTS             of a node's value and gradient: what is tested, first and number
     TRIAL, TRIALS           likewise: what the integrand depends on
     WORK, MODULI            functions, one for each rule of quadrature: DIM x TESTS factors of the
                             test function and its gradient, and their derivatives with respect to
                             DIM x TRIALS numbers; if SYMMETRIC the upper triangle, row by row
     ON_FACETS               whether it is integrated over facets */

#include <string.h>

#define JETS (1 + DIM) /* a value and a gradient */
#define ROWS (DIM * TESTS)
#define COLUMNS (DIM * TRIALS)
#define PAIRS (SYMMETRIC ? ROWS * (ROWS + 1) / 2 : ROWS * COLUMNS)
#define BLOCKS (SYMMETRIC ? NODES * (NODES + 1) / 2 : NODES * NODES)
#define LAST(a) (SYMMETRIC ? a : NODES - 1)

typedef void function(const lanes *given, const double *constants, lanes *found);
enum { VALUE, GRADIENT, AT_POINTS, NORMAL, DETERMINANT, FACET_DETERMINANT };
static const struct { int nodes, size, kind; } fields[] = FIELDS;
enum { FIELD_COUNT = sizeof fields / sizeof *fields };

struct cells {                 /* as Python passes them, see virtual_work.py */
  int count, points;
  const int *numbers;          /* of the chosen cells, which count the rows of all dofs */
  const double *weights;
  const int *rules;            /* of the points */
  const uintptr_t *constants;  /* of the rules */
  const double *shape;         /* gradients of the geometry's basis, (points, CORNERS, DIM) */
  const double *basis;         /* values and gradients of the unknown's, (points, NODES, JETS) */
  const double *normal;        /* of the facet in the reference cell, as long as it is large */
  const int *corners;
  const double *places;
  const uintptr_t *dofs, *values, *tables; /* of the fields */
};
struct batch { int numbers[LANES]; lanes places[CORNERS][DIM], values[VALUES]; };
struct point { lanes jets[NODES][JETS], given[WIDTH], volume; };

static void gather(const struct cells *cells, int first, struct batch *to)
{
  for (int l = 0; l < LANES; ++l) { /* the last batch repeats the last cell */
    int number = cells->numbers[first + l < cells->count ? first + l : cells->count - 1];
    to->numbers[l] = number;
    for (int c = 0; c < CORNERS; ++c)
      for (int i = 0; i < DIM; ++i)
        to->places[c][i][l] = cells->places[DIM * cells->corners[CORNERS * number + c] + i];
    lanes *next = to->values;
    for (int f = 0; f < FIELD_COUNT; ++f) {
      if (fields[f].kind > GRADIENT) continue;
      const int *own = (const int *)cells->dofs[f] + (int64_t)fields[f].nodes * number;
      const double *values = (const double *)cells->values[f];
      for (int n = 0; n < fields[f].nodes; ++n)
        for (int k = 0; k < fields[f].size; ++k)
          (*next++)[l] = values[(int64_t)fields[f].size * own[n] + k];
    }
  }
}

/* The inverse of the Jacobian of the reference cell's map; returns its determinant. */
static lanes inverse(lanes J[DIM][DIM], lanes K[DIM][DIM])
{
  lanes det = {0};
#if DIM == 3
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
      K[i][j] = J[c][a] * J[d][b] - J[c][b] * J[d][a];
    }
#else
  K[0][0] = J[1][1], K[0][1] = -J[0][1], K[1][0] = -J[1][0], K[1][1] = J[0][0];
#endif
  for (int i = 0; i < DIM; ++i) det += J[0][i] * K[i][0];
  for (int i = 0; i < DIM; ++i)
    for (int j = 0; j < DIM; ++j) K[i][j] /= det;
  return det;
}

static void map(const double *reference, lanes K[DIM][DIM], lanes *gradient)
{
  for (int j = 0; j < DIM; ++j) {
    gradient[j] = reference[0] * K[0][j];
    for (int m = 1; m < DIM; ++m) gradient[j] += reference[m] * K[m][j];
  }
}

static lanes each(double (*of)(double), lanes x)
{
  for (int l = 0; l < LANES; ++l) x[l] = of(x[l]);
  return x;
}

/* What integrand and work need at the q-th point. */
static void evaluate(const struct cells *cells, const struct batch *batch, int q, struct point *at)
{
  lanes J[DIM][DIM] = {0}, K[DIM][DIM], normal[DIM], length = {0};
  const double *shape = cells->shape + q * CORNERS * DIM;
  const double *basis = cells->basis + q * NODES * JETS;
  for (int c = 0; c < CORNERS; ++c)
    for (int i = 0; i < DIM; ++i)
      for (int m = 0; m < DIM; ++m) J[i][m] += batch->places[c][i] * shape[DIM * c + m];
  lanes det = inverse(J, K), size = each(fabs, det);
  map(cells->normal, K, normal);
  for (int i = 0; i < DIM; ++i) length += normal[i] * normal[i];
  length = each(sqrt, length);
  at->volume = cells->weights[q] * size * (ON_FACETS ? length : length - length + 1);
  for (int a = 0; a < NODES; ++a, basis += JETS) {
    at->jets[a][0] = length - length + basis[0];
    map(basis + 1, K, at->jets[a] + 1);
  }
  const lanes *values = batch->values;
  lanes *given = at->given;
  for (int f = 0; f < FIELD_COUNT; ++f) {
    int nodes = fields[f].nodes, components = fields[f].size, kind = fields[f].kind;
    if (kind == NORMAL)
      for (int i = 0; i < DIM; ++i) *given++ = normal[i] / length;
    else if (kind == DETERMINANT) *given++ = det;
    else if (kind == FACET_DETERMINANT) *given++ = size * length;
    else if (kind == AT_POINTS)
      for (int k = 0; k < components; ++k, ++given)
        for (int l = 0; l < LANES; ++l) {
          int dof = ((const int *)cells->dofs[f])[(int64_t)nodes * batch->numbers[l] + q];
          (*given)[l] = ((const double *)cells->values[f])[(int64_t)components * dof + k];
        }
    else {
      int terms = kind == GRADIENT ? DIM : 1;
      const double *table = (const double *)cells->tables[f] + q * nodes * terms;
      for (int k = 0; k < components; ++k) {
        lanes local[DIM] = {0};
        for (int n = 0; n < nodes; ++n)
          for (int m = 0; m < terms; ++m) local[m] += values[components * n + k] * table[terms * n + m];
        for (int j = 0; j < terms; ++j, ++given) {
          *given = local[0] * (kind == GRADIENT ? K[0][j] : length - length + 1);
          for (int m = 1; m < terms; ++m) *given += local[m] * K[m][j];
        }
      }
      values += nodes * components;
    }
  }
}

void add_residual(const struct cells *cells, const int *nodes, double *b)
{
  static function *const work[] = WORK;
  struct batch batch;
  struct point at;
  for (int first = 0; first < cells->count; first += LANES) {
    lanes sums[NODES][DIM] = {0}, factors[ROWS];
    gather(cells, first, &batch);
    for (int q = 0; q < cells->points; ++q) {
      evaluate(cells, &batch, q, &at);
      work[cells->rules[q]](at.given, (const double *)cells->constants[cells->rules[q]], factors);
      for (int i = 0; i < ROWS; ++i) factors[i] *= at.volume;
      for (int a = 0; a < NODES; ++a)
        for (int i = 0; i < DIM; ++i)
          for (int m = 0; m < TESTS; ++m)
            sums[a][i] += factors[TESTS * i + m] * at.jets[a][TEST + m];
    }
    for (int l = 0; l < LANES && first + l < cells->count; ++l)
      for (int a = 0; a < NODES; ++a)
        for (int i = 0; i < DIM; ++i)
          b[DIM * nodes[NODES * batch.numbers[l] + a] + i] += sums[a][i][l];
  }
}

static void add_blocks(const struct point *at, lanes A[ROWS][COLUMNS], const int8_t *is_tested,
                       lanes blocks[BLOCKS][DIM * DIM])
{
  for (int a = 0; a < NODES; ++a) {
    lanes T[DIM][COLUMNS];
    if (!is_tested[a]) {
      blocks += LAST(a) + 1;
      continue;
    }
    for (int i = 0; i < DIM; ++i)
      for (int k = 0; k < COLUMNS; ++k) {
        T[i][k] = at->jets[a][TEST] * A[TESTS * i][k];
        for (int m = 1; m < TESTS; ++m) T[i][k] += at->jets[a][TEST + m] * A[TESTS * i + m][k];
      }
    for (int b = 0; b <= LAST(a); ++b, ++blocks)
      for (int i = 0; i < DIM; ++i)
        for (int k = 0; k < DIM; ++k) {
          lanes sum = (*blocks)[DIM * i + k];
          for (int n = 0; n < TRIALS; ++n) sum += T[i][TRIALS * k + n] * at->jets[b][TRIAL + n];
          (*blocks)[DIM * i + k] = sum;
        }
  }
}

/* Adds the blocks of one cell where `positions` say, but none where they are negative. */
static void insert(const lanes blocks[BLOCKS][DIM * DIM], int lane, const int *positions,
                   double *matrix)
{
  for (int a = 0; a < NODES; ++a)
    for (int b = 0; b <= LAST(a); ++b, ++blocks) {
      int here = positions[NODES * a + b], there = positions[NODES * b + a];
      if (here >= 0)
        for (int k = 0; k < DIM * DIM; ++k)
          matrix[(int64_t)DIM * DIM * here + k] += (*blocks)[k][lane];
      if (SYMMETRIC && a != b && there >= 0)
        for (int i = 0; i < DIM; ++i)
          for (int k = 0; k < DIM; ++k)
            matrix[(int64_t)DIM * DIM * there + DIM * k + i] += (*blocks)[DIM * i + k][lane];
    }
}

void add_tangent(const struct cells *cells, const int8_t *is_tested, const int *positions,
                 double *matrix)
{
  static function *const moduli[] = MODULI;
  struct batch batch;
  struct point at;
  for (int first = 0; first < cells->count; first += LANES) {
    lanes blocks[BLOCKS][DIM * DIM], found[PAIRS], A[ROWS][COLUMNS];
    memset(blocks, 0, sizeof blocks);
    gather(cells, first, &batch);
    for (int q = 0; q < cells->points; ++q) {
      evaluate(cells, &batch, q, &at);
      moduli[cells->rules[q]](at.given, (const double *)cells->constants[cells->rules[q]], found);
      const lanes *next = found;
      for (int i = 0; i < ROWS; ++i)
        for (int j = SYMMETRIC ? i : 0; j < COLUMNS; ++j) {
          A[i][j] = *next++ * at.volume;
          if (SYMMETRIC) A[j][i] = A[i][j];
        }
      add_blocks(&at, A, is_tested, blocks);
    }
    for (int l = 0; l < LANES && first + l < cells->count; ++l)
      insert(blocks, l, positions + (int64_t)NODES * NODES * batch.numbers[l], matrix);
  }
}

/* Positions of the blocks of each cell in a matrix with ascending columns; -1 if not wanted. */
void locate(int count, const int *nodes, const int8_t *is_tested, const int64_t *starts,
            const int *columns, const int8_t *is_wanted, int *positions)
{
  for (int cell = 0; cell < count; ++cell, nodes += NODES)
    for (int a = 0; a < NODES; ++a)
      for (int b = 0; b < NODES; ++b) {
        int64_t low = starts[nodes[a]], high = starts[nodes[a] + 1];
        while (low < high) {
          int64_t middle = (low + high) / 2;
          if (columns[middle] < nodes[b]) low = middle + 1;
          else high = middle;
        }
        int wanted = is_tested[a] && is_wanted[nodes[a]] && is_wanted[nodes[b]];
        *positions++ = wanted ? (int)low : -1;
      }
}
