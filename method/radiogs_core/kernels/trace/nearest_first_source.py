"""Gathering the hits of a ray nearest first: what lies beyond the last hit that counts is not looked at."""

STACK = 96
"""Entries of the traversal stack: 7 (depth - 1) + 1 are needed, so 96 allows 14 levels (8^14 leaves)."""

NEAREST_FIRST = """
    SCALAR left[BUFFER + 1];
    SCALAR limit = huge;
    int found = 0, nodes = 0, leaf_count = 0, top = 0, closed = 0, node = 0;
    int stack_node[STACK];
    SCALAR stack_t[STACK];
    left[0] = start_rest;
    for (;;) {
        if (node >= 0) {
            ++nodes;
            SCALAR enter[8];
            const int* child = children.data + (long long)node * 8;
            int bits = entered(node, limit, enter);
            if (bits) {
                // The nearest child stays in hand, the others go on the stack, the farthest deepest.
                int c = LOWEST(bits);
                bits &= bits - 1;
                int next = child[c];
                SCALAR next_t = enter[c];
                const int begin = top;
                while (bits) {
                    c = LOWEST(bits);
                    bits &= bits - 1;
                    int other = child[c];
                    SCALAR other_t = enter[c];
                    if (other_t < next_t) {
                        const int swap = next;
                        next = other;
                        other = swap;
                        const SCALAR swap_t = next_t;
                        next_t = other_t;
                        other_t = swap_t;
                    }
                    int at = top++;
                    while (at > begin && stack_t[at - 1] < other_t) {
                        stack_t[at] = stack_t[at - 1];
                        stack_node[at] = stack_node[at - 1];
                        --at;
                    }
                    stack_t[at] = other_t;
                    stack_node[at] = other;
                    // What waits will be read from beyond the second-level cache (measured: 7 %).
                    if (other >= 0) {
                        FETCH(boxes.data + (long long)other * 48);
                        FETCH(boxes.data + (long long)other * 48 + 16);
                        FETCH(boxes.data + (long long)other * 48 + 32);
                    } else {
                        fetch_leaf(-1 - other);
                    }
                }
                node = next;
                continue;
            }
        } else {
            ++leaf_count;
            const int leaf = -1 - node;
            SCALAR depth[8], bells[8];
            int bits = met_on(leaf, limit, depth, bells);
            if (bits)
                for (int c = 0; c < 8; c += LANES) write(bells + c, bell(read(bells + c)));
            while (bits) {
                const int c = LOWEST(bits);
                bits &= bits - 1;
                const SCALAR t = depth[c];
                const int id = order.data[leaf * 8 + c];
                if (t == start_t && id <= start_id) continue;
                if (t > limit) continue;
                int at = found;
                while (at > 0 && (hit_t[at - 1] > t || (hit_t[at - 1] == t && hit_id[at - 1] > id))) --at;
                if (at >= BUFFER || (closed && at >= found)) continue;
                if (found < BUFFER) ++found;
                for (int j = found - 1; j > at; --j) {
                    hit_t[j] = hit_t[j - 1];
                    hit_id[j] = hit_id[j - 1];
                    hit_alpha[j] = hit_alpha[j - 1];
                }
                const SCALAR alpha = leaves.data[leaf * 112LL + 96 + c] * bells[c];
                hit_t[at] = t;
                hit_id[at] = id;
                hit_alpha[at] = alpha < SCALAR(MAX_ALPHA) ? alpha : SCALAR(MAX_ALPHA);
                closed = 0;
                for (int j = at; j < found; ++j) {
                    left[j + 1] = left[j] * (SCALAR(1) - hit_alpha[j]);
                    if (left[j + 1] < stop) {
                        found = j + 1;
                        closed = 1;
                    }
                }
                if (closed || found == BUFFER) limit = hit_t[found - 1];
            }
        }
        do {
            if (top == 0) goto done;
            --top;
        } while (stack_t[top] > limit);
        node = stack_node[top];
    }
done:
    used.data[0] += found;
    found_out.data[slot] = found;
    rest_out.data[slot] = found == BUFFER && left[found] >= stop ? left[found] : SCALAR(FINISHED);
    nodes_out.data[slot] = nodes;
    leaves_out.data[slot] = leaf_count;
"""
