/* Products with many small matrices of equal size, one for each line of nodes.

   Each is stored in strips of WIDTH rows, the last filled with zeros, and each strip column by
   column, so that the processor multiplies WIDTH numbers at once. */

typedef float strip __attribute__((vector_size(4 * WIDTH), aligned(4), may_alias));
typedef double sums __attribute__((vector_size(8 * WIDTH)));

void multiply(int lines, int length, const float *matrices, const double *x, double *restrict y)
{
  const int strips = (length + WIDTH - 1) / WIDTH;
  for (int line = 0; line < lines; ++line, x += length, y += length)
    for (int s = 0; s < strips; ++s) {
      const int rows = s < strips - 1 ? WIDTH : length - WIDTH * s;
      sums sum = {0};
      for (int c = 0; c < length; ++c, matrices += WIDTH)
        sum += __builtin_convertvector(*(const strip *)matrices, sums) * x[c];
      for (int r = 0; r < rows; ++r) y[WIDTH * s + r] = sum[r];
    }
}
