"""Gathering all hits of a ray at once: breadth first through the tree, then its leaves, then the hits in order.

No node waits for what was found at the one before, and nothing branches on it, so that the processor works on several
of them at a time. Nearest first takes twice as long on M, although it leaves out what lies behind an opaque surface
(there a fifth of the nodes and leaves). On the CPU alone.
"""

from ..lanes import SQUEEZE

MOST_NODES = 512
"""Nodes, and leaves, that a ray may enter; one that enters more is followed nearest first."""

MOST_HITS = 248
"""Hits that are put in order together; a ray with more is followed nearest first."""

BREADTH_FIRST = (
    """
#if !ON_CUDA
"""
    + SQUEEZE
    + """
    // A later round begins amid hits, which its first one has to leave out.
    if (start_id == NO_SURFEL) {
        int within[MOST_NODES + 8], leaf_of[MOST_NODES + 8];
        int entered_nodes = 1, entered_leaves = 0, nodes = 0, leaf_count = 0, met = 0;
        within[0] = 0;
        for (; nodes < entered_nodes && entered_nodes <= MOST_NODES && entered_leaves <= MOST_NODES; ++nodes) {
            SCALAR enter[8];
            const int hit = entered(within[nodes], huge, enter);
            Eight child;
            memcpy(&child, children.data + (long long)within[nodes] * 8, sizeof(child));
            const int of_leaves = hit & bits_of(child < 0), of_nodes = hit ^ of_leaves;
            const Eight deeper = squeezed(child, of_nodes), reached = squeezed(-1 - child, of_leaves);
            memcpy(within + entered_nodes, &deeper, sizeof(deeper));
            memcpy(leaf_of + entered_leaves, &reached, sizeof(reached));
            entered_nodes += __builtin_popcount(of_nodes);
            entered_leaves += __builtin_popcount(of_leaves);
        }

        SCALAR depth[8 * MOST_NODES + 64], square[8 * MOST_NODES + 64];
        int place[MOST_HITS + 8];
        const bool all_nodes = nodes == entered_nodes;
        for (; all_nodes && leaf_count < entered_leaves && met <= MOST_HITS; ++leaf_count) {
            if (leaf_count + 3 < entered_leaves) fetch_leaf(leaf_of[leaf_count + 3]);
            const int first = 8 * leaf_count;
            const int hit = met_on(leaf_of[leaf_count], huge, depth + first, square + first)
                & bits_of(read(depth + first) > start_t);
            const Eight places = squeezed(first + Eight{0, 1, 2, 3, 4, 5, 6, 7}, hit);
            memcpy(place + met, &places, sizeof(places));
            met += __builtin_popcount(hit);
        }

        if (all_nodes && leaf_count == entered_leaves && met <= MOST_HITS) {
            SCALAR t_of[MOST_HITS + 8], bell_of[MOST_HITS + 8], alpha_of[MOST_HITS + 8];
            int id_of[MOST_HITS + 8], rank_of[MOST_HITS + 8];
            const int padded = (met + 7) / 8 * 8;
            for (int i = 0; i < padded; ++i) {
                const int at = i < met ? place[i] : 0, lane = at & 7, leaf = leaf_of[at >> 3];
                t_of[i] = depth[at];
                bell_of[i] = square[at];
                alpha_of[i] = leaves.data[leaf * 112LL + 96 + lane];
                id_of[i] = order.data[leaf * 8 + lane];
            }
            // A hit's place is the number of hits before it.
            for (int i = 0; i < padded; i += 8) {
                const Lanes t = read(t_of + i), alpha = read(alpha_of + i) * bell(read(bell_of + i));
                Eight id, before = Eight{};
                memcpy(&id, id_of + i, sizeof(id));
                for (int j = 0; j < met; ++j)
                    before -= __builtin_convertvector(t_of[j] < t, Eight)
                        | (__builtin_convertvector(t_of[j] == t, Eight) & (id_of[j] < id));
                memcpy(rank_of + i, &before, sizeof(before));
                write(alpha_of + i, alpha < SCALAR(MAX_ALPHA) ? alpha : Lanes{} + SCALAR(MAX_ALPHA));
            }
            for (int i = 0; i < met; ++i) {
                hit_t[rank_of[i]] = t_of[i];
                hit_id[rank_of[i]] = id_of[i];
                hit_alpha[rank_of[i]] = alpha_of[i];
            }
            SCALAR rest = start_rest;
            int found = 0;
            for (; found < met && rest >= stop; ++found) rest *= SCALAR(1) - hit_alpha[found];
            used.data[0] += found;
            found_out.data[slot] = found;
            rest_out.data[slot] = SCALAR(FINISHED);
            nodes_out.data[slot] = nodes;
            leaves_out.data[slot] = leaf_count;
            return;
        }
    }
#endif
"""
)
