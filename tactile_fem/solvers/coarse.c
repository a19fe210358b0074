/* The coarse operator P^T A P, for a matrix of dense blocks and an interpolation of their nodes. */

/* Add w_i w_j a_ij to the block of each pair of coarse nodes between which i and j are interpolated.

   Children are the fine rows of a coarse node, parents the coarse nodes of a fine column. `place`
   is room for a number of each coarse node. */
void add_coarse(int nodes, const int *child_starts, const int *children, const double *child_weights,
                const int *parent_starts, const int *parents, const double *parent_weights,
                const long long *starts, const int *columns, const double *blocks,
                const int *coarse_starts, const int *coarse_columns, int *place,
                double *restrict coarse)
{
  for (int node = 0; node < nodes; ++node) {
    for (int k = coarse_starts[node]; k < coarse_starts[node + 1]; ++k)
      place[coarse_columns[k]] = k;
    for (int c = child_starts[node]; c < child_starts[node + 1]; ++c) {
      const int i = children[c];
      for (long long k = starts[i]; k < starts[i + 1]; ++k) {
        const double *a = blocks + SIZE * SIZE * k;
        const int j = columns[k];
        for (int p = parent_starts[j]; p < parent_starts[j + 1]; ++p) {
          const double weight = child_weights[c] * parent_weights[p];
          double *sum = coarse + SIZE * SIZE * place[parents[p]];
          for (int e = 0; e < SIZE * SIZE; ++e) sum[e] += weight * a[e];
        }
      }
    }
  }
}
