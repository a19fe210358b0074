/* Products with matrices of dense blocks, whose numbers are stored as REAL.

   Sums are double: rounded vectors would let the last digits of a message decide about iterations.

   Blocks are stored row by row, and so are the SIZE x SIZE numbers of each. Vectors hold SIZE
   numbers of every LANES, so that the processor multiplies a block's row at once; what it then reads
   of the next row, or of what follows the last block, meets numbers that nothing reads. */

#define LANES_OF(number) \
  __attribute__((vector_size(LANES * sizeof(number)), aligned(sizeof(number)), may_alias))

typedef REAL stored LANES_OF(REAL);
typedef double lanes LANES_OF(double);
#define ROW(a) __builtin_convertvector(*(const stored *)(a), lanes)

#define BLOCK (SIZE * SIZE)
#define AHEAD (4000 / sizeof(REAL)) /* half and twice as far make no difference */

/* Begin a product: copy this rank's part of a vector, and let its result be zero. */
void begin(int rows, const double *x, double *restrict with_ghosts,
           double *restrict y)
{
  for (int i = 0; i < rows; ++i)
    for (int r = 0; r < SIZE; ++r) with_ghosts[LANES * i + r] = x[SIZE * i + r];
  for (int i = 0; i < LANES * rows; ++i) y[i] = 0;
}

/* Return the result of a product. */
void end(int rows, const double *y, double *restrict result)
{
  for (int i = 0; i < rows; ++i)
    for (int r = 0; r < SIZE; ++r) result[SIZE * i + r] = y[LANES * i + r];
}

/* Copy chosen blocks of a matrix. */
void copy(long long count, const long long *chosen, const double *values, REAL *restrict blocks)
{
  for (long long k = 0; k < count; ++k)
    for (int e = 0; e < BLOCK; ++e) blocks[BLOCK * k + e] = values[BLOCK * chosen[k] + e];
}

static void add_sums(const lanes *sum, double *y)
{
  for (int r = 0; r < SIZE; ++r)
    for (int c = 0; c < SIZE; ++c) y[r] += sum[r][c];
}

/* y += A x */
void add_product(int rows, const long long *starts, const int *columns, const REAL *blocks,
                 const double *x, double *restrict y)
{
  for (int i = 0; i < rows; ++i) {
    lanes sum[SIZE] = {0};
    for (long long k = starts[i]; k < starts[i + 1]; ++k) {
      const REAL *a = blocks + BLOCK * k;
      const lanes xj = *(const lanes *)(x + LANES * columns[k]);
      __builtin_prefetch(a + AHEAD);
      for (int r = 0; r < SIZE; ++r) sum[r] += ROW(a + SIZE * r) * xj;
    }
    add_sums(sum, y + LANES * i);
  }
}

/* The same with a symmetric matrix, whose blocks are stored up to the diagonal: it ends a row. */
void add_symmetric_product(int rows, const long long *starts, const int *columns,
                           const REAL *blocks, const double *x, double *restrict y)
{
  for (int i = 0; i < rows; ++i) {
    const REAL *a = blocks + BLOCK * starts[i];
    const lanes xi = *(const lanes *)(x + LANES * i);
    lanes sum[SIZE] = {0};
    for (long long k = starts[i]; k < starts[i + 1] - 1; ++k, a += BLOCK) {
      const lanes xj = *(const lanes *)(x + LANES * columns[k]);
      lanes turned = {0};
      __builtin_prefetch(a + AHEAD);
      for (int r = 0; r < SIZE; ++r) {
        sum[r] += ROW(a + SIZE * r) * xj;
        turned += ROW(a + SIZE * r) * xi[r];
      }
      *(lanes *)(y + LANES * columns[k]) += turned;
    }
    for (int r = 0; r < SIZE; ++r) sum[r] += ROW(a + SIZE * r) * xi;
    add_sums(sum, y + LANES * i);
  }
}
