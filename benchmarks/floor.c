/* The floor: the growing map of pacnet/attention/sofm.py in plain C, one call for a stream.

   Fixed capacities, float32. Prototypes lie in blocks of 16 nodes, dimension by dimension, so that
   the compiler searches 16 nodes at a time. Each node keeps its neighbours in order of number. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 16, NO_NODE = -1 };

typedef struct {
    int64_t dimensions;
    float novelty_threshold, winner_rate, neighbour_rate;
    float habituated_below, resting, floor, winner_decay, neighbour_decay;
    int32_t insert_only_when_habituated, insert_at_midpoint;
    int32_t ignore_when_habituated, habituation_scales_learning;
    int64_t forgetting_interval, max_edge_age; /* interval 0: never forgets */
} Config;

typedef struct { /* one row a sample, as pacnet's Observation */
    int64_t *winner, *runner_up, *deleted;
    float *activation;
    uint8_t *novelty, *inserted, *ignored, *dishabituated;
} Record;

typedef struct {
    const Config *config;
    int64_t count, capacity, degree_capacity, time;
    float *prototype;       /* [capacity / LANES][dimensions][LANES] */
    float *habituation;     /* [capacity] */
    int64_t *habituated_at; /* [capacity] */
    int32_t *degree;        /* [capacity] */
    int32_t *neighbour;     /* [capacity][degree_capacity], in order of number */
    int32_t *edge;          /* the same: where the age stands */
    int32_t *age;           /* [capacity * degree_capacity / 2] */
    int32_t *free_edge, n_free;
    int failed; /* a capacity was too small */
} Map;

static float *at(const Map *map, int64_t node) {
    return map->prototype + node / LANES * LANES * map->config->dimensions + node % LANES;
}

/* 16 numbers, in one vector register or several. */
typedef float Floats __attribute__((vector_size(LANES * sizeof(float))));
typedef int32_t Ints __attribute__((vector_size(LANES * sizeof(int32_t))));

static Floats choose(Ints where, Floats yes, Floats no) {
    return (Floats)((where & (Ints)yes) | (~where & (Ints)no));
}

/* The lane of the smallest number; ties go to the lowest block, then to the lowest lane. */
static int first_lane(Floats value, Ints block) {
    int lane = 0;
    for (int l = 1; l < LANES; l++)
        if (value[l] < value[lane] || (value[l] == value[lane] && block[l] < block[lane])) lane = l;
    return lane;
}

/* The indices of the smallest and the second smallest; ties go to the lowest index. */
static void search(const Map *map, const float *restrict x, int64_t *winner, int64_t *runner_up,
                   float *smallest) {
    const int64_t dimensions = map->config->dimensions;
    const int32_t blocks = (int32_t)((map->count + LANES - 1) / LANES);
    Floats best = (Floats){0} + FLT_MAX, second = best;
    Ints best_at = {0}, second_at = {0}; /* numbers of blocks */
    for (int32_t b = 0; b < blocks; b++) { /* unused rows hold a huge prototype */
        const Floats *restrict w = (const Floats *)map->prototype + b * dimensions;
        Floats sum = {0}, odd = {0}; /* two sums, to break the dependency chain */
        for (int64_t d = 0; d + 1 < dimensions; d += 2) {
            const Floats difference = w[d] - x[d], next = w[d + 1] - x[d + 1];
            sum += difference * difference;
            odd += next * next;
        }
        if (dimensions % 2) {
            const Floats last = w[dimensions - 1] - x[dimensions - 1];
            sum += last * last;
        }
        sum += odd;
        const Ints nearest = sum < best, nearer = sum < second, block = (Ints){0} + b;
        second = choose(nearest, best, choose(nearer, sum, second));
        second_at = (Ints)choose(nearest, (Floats)best_at, choose(nearer, (Floats)block, (Floats)second_at));
        best = choose(nearest, sum, best);
        best_at = (Ints)choose(nearest, (Floats)block, (Floats)best_at);
    }
    int lane = first_lane(best, best_at);
    *winner = best_at[lane] * LANES + lane;
    *smallest = best[lane];
    best[lane] = second[lane];
    best_at[lane] = second_at[lane];
    lane = first_lane(best, best_at);
    *runner_up = map->count > 1 ? best_at[lane] * LANES + lane : NO_NODE;
}

static int64_t add_node(Map *map) {
    if (map->count == map->capacity) {
        map->failed = 1;
        return map->count - 1;
    }
    const int64_t node = map->count++;
    map->habituation[node] = map->config->resting;
    map->habituated_at[node] = NO_NODE;
    map->degree[node] = 0;
    return node;
}

/* Index of a neighbour in a node's list, or where to insert it. */
static int place(const Map *map, int64_t node, int64_t other) {
    const int32_t *list = map->neighbour + node * map->degree_capacity;
    int i = 0;
    while (i < map->degree[node] && list[i] < other) i++;
    return i;
}

static int is_at(const Map *map, int64_t node, int64_t other, int i) {
    return i < map->degree[node] && map->neighbour[node * map->degree_capacity + i] == other;
}

static void link_one(Map *map, int64_t node, int64_t other, int32_t edge) {
    const int i = place(map, node, other), n = map->degree[node]++ - i;
    int32_t *list = map->neighbour + node * map->degree_capacity + i;
    int32_t *edges = map->edge + node * map->degree_capacity + i;
    memmove(list + 1, list, n * sizeof *list);
    memmove(edges + 1, edges, n * sizeof *edges);
    *list = (int32_t)other;
    *edges = edge;
}

static void unlink_one(Map *map, int64_t node, int i) {
    const int n = --map->degree[node] - i;
    int32_t *list = map->neighbour + node * map->degree_capacity + i;
    int32_t *edges = map->edge + node * map->degree_capacity + i;
    memmove(list, list + 1, n * sizeof *list);
    memmove(edges, edges + 1, n * sizeof *edges);
}

static void join(Map *map, int64_t one, int64_t other) {
    if (other == NO_NODE) return;
    const int i = place(map, one, other);
    if (is_at(map, one, other, i)) {
        map->age[map->edge[one * map->degree_capacity + i]] = 0;
        return;
    }
    const int64_t full = map->degree_capacity;
    if (map->degree[one] == full || map->degree[other] == full || map->n_free == 0) {
        map->failed = 1;
        return;
    }
    const int32_t edge = map->free_edge[--map->n_free];
    map->age[edge] = 0;
    link_one(map, one, other, edge);
    link_one(map, other, one, edge);
}

static void part(Map *map, int64_t one, int64_t other) {
    const int i = place(map, one, other);
    if (!is_at(map, one, other, i)) return;
    map->free_edge[map->n_free++] = map->edge[one * map->degree_capacity + i];
    unlink_one(map, one, i);
    unlink_one(map, other, place(map, other, one));
}

/* Deletes a node without edges; later nodes move down and keep their order. */
static void delete_node(Map *map, int64_t node) {
    const int64_t dimensions = map->config->dimensions, full = map->degree_capacity;
    const int64_t after = --map->count - node;
    for (int64_t n = node; n < map->count; n++)
        for (int64_t d = 0; d < dimensions; d++) at(map, n)[d * LANES] = at(map, n + 1)[d * LANES];
    for (int64_t d = 0; d < dimensions; d++) at(map, map->count)[d * LANES] = 1e18f;
#define SHIFT(rows, width) \
    memmove(rows + node * (width), rows + (node + 1) * (width), after * (width) * sizeof *(rows))
    SHIFT(map->habituation, 1);
    SHIFT(map->habituated_at, 1);
    SHIFT(map->degree, 1);
    SHIFT(map->neighbour, full);
    SHIFT(map->edge, full);
    for (int64_t n = 0; n < map->count; n++)
        for (int i = 0; i < map->degree[n]; i++)
            map->neighbour[n * full + i] -= map->neighbour[n * full + i] > node;
}

static int is_habituated(const Map *map, int64_t node) {
    return map->habituation[node] < map->config->habituated_below;
}

static int forget(Map *map, int64_t node) {
    const int64_t interval = map->config->forgetting_interval, since = map->habituated_at[node];
    if (interval == 0 || since == NO_NODE || map->time - since < interval) return 0;
    map->habituation[node] = map->config->resting;
    map->habituated_at[node] = NO_NODE;
    return 1;
}

static void move_and_habituate(Map *map, int64_t node, const float *restrict x, float rate,
                               float decay) {
    const Config *config = map->config;
    float *restrict w = at(map, node), *habituation = map->habituation + node;
    const float fraction = config->habituation_scales_learning ? rate * *habituation : rate;
    for (int64_t d = 0; d < config->dimensions; d++)
        w[d * LANES] += fraction * (x[d] - w[d * LANES]);
    *habituation = config->floor + (*habituation - config->floor) * decay;
    if (is_habituated(map, node) && map->habituated_at[node] == NO_NODE)
        map->habituated_at[node] = map->time;
}

static void insert(Map *map, const float *restrict x, int64_t winner, int64_t runner_up) {
    const Config *config = map->config;
    const int64_t node = add_node(map);
    float *w = at(map, node);
    if (winner == NO_NODE || !config->insert_at_midpoint) {
        for (int64_t d = 0; d < config->dimensions; d++) w[d * LANES] = x[d];
        join(map, node, winner);
        return;
    }
    const float *old = at(map, winner);
    for (int64_t d = 0; d < config->dimensions; d++) w[d * LANES] = (old[d * LANES] + x[d]) / 2;
    join(map, node, winner);
    if (runner_up == NO_NODE) return;
    join(map, node, runner_up);
    part(map, winner, runner_up);
}

/* Ages the winner's edges, deletes the old ones, then nodes without edges. */
static int64_t age_edges(Map *map, int64_t winner) {
    const int64_t first = winner * map->degree_capacity;
    int any = 0;
    for (int i = 0; i < map->degree[winner]; i++)
        any |= ++map->age[map->edge[first + i]] > map->config->max_edge_age;
    if (!any) return 0;
    int64_t deleted = 0;
    for (int i = map->degree[winner] - 1; i >= 0; i--) { /* from the end: numbers may move down */
        const int64_t row = winner * map->degree_capacity;
        const int64_t other = map->neighbour[row + i];
        if (map->age[map->edge[row + i]] <= map->config->max_edge_age) continue;
        part(map, winner, other);
        if (map->degree[other] > 0) continue;
        delete_node(map, other);
        winner -= other < winner;
        deleted++;
    }
    return deleted;
}

static void learn(Map *map, const float *restrict x, const Record *record, int64_t t) {
    const Config *config = map->config;
    int64_t winner = NO_NODE, runner_up = NO_NODE;
    float smallest = FLT_MAX;
    map->time++;
    if (map->count > 0) search(map, x, &winner, &runner_up, &smallest);
    const float activation = winner == NO_NODE ? 0 : expf(-sqrtf(smallest));
    const int novel = activation < config->novelty_threshold;
    record->winner[t] = winner;
    record->runner_up[t] = runner_up;
    record->activation[t] = activation;
    record->novelty[t] = (uint8_t)novel;
    record->dishabituated[t] = winner != NO_NODE && forget(map, winner);
    record->inserted[t] = record->ignored[t] = 0;
    record->deleted[t] = 0;
    const int habituated = winner != NO_NODE && is_habituated(map, winner);
    if (winner == NO_NODE || (novel && (habituated || !config->insert_only_when_habituated))) {
        insert(map, x, winner, runner_up);
        record->inserted[t] = 1;
        return;
    }
    if (habituated && config->ignore_when_habituated) {
        record->ignored[t] = 1;
        return;
    }
    join(map, winner, runner_up);
    move_and_habituate(map, winner, x, config->winner_rate, config->winner_decay);
    const int32_t *list = map->neighbour + winner * map->degree_capacity;
    for (int i = 0; i < map->degree[winner]; i++) {
        forget(map, list[i]);
        if (config->ignore_when_habituated && is_habituated(map, list[i])) continue;
        move_and_habituate(map, list[i], x, config->neighbour_rate, config->neighbour_decay);
    }
    record->deleted[t] = age_edges(map, winner);
}

static int allocate(Map *map) {
    const int64_t nodes = map->capacity, edges = nodes * map->degree_capacity;
    map->prototype = aligned_alloc(64, nodes * map->config->dimensions * sizeof(float));
    map->habituation = malloc(nodes * sizeof(float));
    map->habituated_at = malloc(nodes * sizeof(int64_t));
    map->degree = malloc(nodes * sizeof(int32_t));
    map->neighbour = malloc(edges * sizeof(int32_t));
    map->edge = malloc(edges * sizeof(int32_t));
    map->age = malloc(edges / 2 * sizeof(int32_t));
    map->free_edge = malloc(edges / 2 * sizeof(int32_t));
    if (!map->prototype || !map->habituation || !map->habituated_at || !map->degree ||
        !map->neighbour || !map->edge || !map->age || !map->free_edge)
        return 0;
    for (int64_t i = 0; i < nodes * map->config->dimensions; i++) map->prototype[i] = 1e18f;
    for (int64_t i = 0; i < edges / 2; i++) map->free_edge[i] = (int32_t)(edges / 2 - 1 - i);
    map->n_free = (int32_t)(edges / 2);
    return 1;
}

static void release(Map *map) {
    void *rows[] = {map->prototype, map->habituation, map->habituated_at, map->degree,
                    map->neighbour, map->edge, map->age, map->free_edge};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) free(rows[i]);
}

/* Observes percepts [samples][dimensions]; returns the number of nodes, or -1 where a capacity
   (nodes a multiple of 16) was too small. */
int64_t observe(const Config *config, const float *percepts, int64_t samples, int64_t capacity,
                int64_t degree_capacity, const Record *record) {
    Map map = {.config = config, .capacity = capacity, .degree_capacity = degree_capacity};
    if (!allocate(&map)) map.failed = 1;
    for (int64_t t = 0; t < samples && !map.failed; t++)
        learn(&map, percepts + t * config->dimensions, record, t);
    release(&map);
    return map.failed ? -1 : map.count;
}

/* Sums numbers repeatedly, to measure how fast the machine reads them; count: whole rows. */
float read_all(const float *numbers, int64_t count, int64_t repeats) {
    Floats sum[4] = {{0}, {0}, {0}, {0}};
    for (int64_t r = 0; r < repeats; r++) {
        const Floats *row = (const Floats *)numbers;
        for (int64_t i = 0; i < count / LANES; i += 4)
            for (int64_t j = 0; j < 4; j++) sum[j] += row[i + j];
        __asm__ volatile("" ::: "memory"); /* else the compiler would read once */
    }
    const Floats all = sum[0] + sum[1] + sum[2] + sum[3];
    float total = 0;
    for (int l = 0; l < LANES; l++) total += all[l];
    return total;
}
