/* Products with matrices of dense blocks, y += A x.

   Blocks are stored row by row, and so are the SIZE x SIZE numbers of each. Such a product is as
   fast as the memory delivers the blocks, if they are asked for in time. */

#define AHEAD (57 * SIZE * SIZE) /* numbers; half and twice as many make no difference */

void add_product(int rows, const long long *starts, const int *columns, const double *blocks,
                 const double *x, double *restrict y)
{
  for (int i = 0; i < rows; ++i) {
    double sum[SIZE] = {0};
    for (long long k = starts[i]; k < starts[i + 1]; ++k) {
      const double *a = blocks + SIZE * SIZE * k, *xj = x + SIZE * columns[k];
      __builtin_prefetch(a + AHEAD);
      for (int r = 0; r < SIZE; ++r)
        for (int c = 0; c < SIZE; ++c) sum[r] += a[SIZE * r + c] * xj[c];
    }
    for (int r = 0; r < SIZE; ++r) y[SIZE * i + r] += sum[r];
  }
}

/* The same with a symmetric matrix, whose blocks are stored up to the diagonal: it ends a row. */
void add_symmetric_product(int rows, const long long *starts, const int *columns,
                           const double *blocks, const double *x, double *restrict y)
{
  for (int i = 0; i < rows; ++i) {
    double sum[SIZE] = {0};
    const double *xi = x + SIZE * i, *a = blocks + SIZE * SIZE * starts[i];
    for (long long k = starts[i]; k < starts[i + 1] - 1; ++k, a += SIZE * SIZE) {
      const double *xj = x + SIZE * columns[k];
      double *yj = y + SIZE * columns[k], turned[SIZE] = {0};
      __builtin_prefetch(a + AHEAD);
      for (int r = 0; r < SIZE; ++r)
        for (int c = 0; c < SIZE; ++c) {
          sum[r] += a[SIZE * r + c] * xj[c];
          turned[c] += a[SIZE * r + c] * xi[r];
        }
      for (int c = 0; c < SIZE; ++c) yj[c] += turned[c];
    }
    for (int r = 0; r < SIZE; ++r) {
      for (int c = 0; c < SIZE; ++c) sum[r] += a[SIZE * r + c] * xi[c];
      y[SIZE * i + r] += sum[r];
    }
  }
}
