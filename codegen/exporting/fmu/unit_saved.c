/* Saved states of instances, in memory and as bytes. */
#include "unit.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static size_t saved_bytes(const unit *x) { return (size_t)x->saved*sizeof(scalar); }

/* A digest (FNV-1a) of the token and of a saved state; bytes without it are refused. */
static uint64_t digest_of(const unit *x, const unsigned char *bytes)
{
    uint64_t found = 14695981039346656037u;
    for (const char *at = x->model->token; *at; ++at) found = (found ^ (unsigned char)*at)*1099511628211u;
    for (size_t i = 0; i < saved_bytes(x); ++i) found = (found ^ bytes[i])*1099511628211u;
    return found;
}

size_t unit_serialized_bytes(const unit *x) { return sizeof(uint64_t) + saved_bytes(x); }

/* Saves the state of an instance to *saved, which is allocated if it is null. */
int unit_save(unit *x, void **saved)
{
    if (unit_has(x, 1, saved, saved)) return UNIT_ERROR;
    if (!*saved) *saved = malloc(saved_bytes(x));
    if (!*saved) return unit_say(x, UNIT_ERROR, "there is not enough memory");
    memcpy(*saved, x->mode, saved_bytes(x));
    return UNIT_OK;
}

int unit_restore(unit *x, const void *saved)
{
    if (!saved) return unit_say(x, UNIT_ERROR, "the saved state is a null pointer");
    const scalar mode = *(const scalar *)saved;
    if (x->integrates ? mode == EVENT_MODE || mode == CONTINUOUS_TIME : mode == STEP_MODE)
        return unit_say(x, UNIT_ERROR, "the saved state is that of an instance for %s, but this instance is for %s",
            x->integrates ? "Model Exchange" : "Co-Simulation", x->integrates ? "Co-Simulation" : "Model Exchange");
    memcpy(x->mode, saved, saved_bytes(x));
    x->computed = 0;
    return UNIT_OK;
}

/* Writes a digest and the saved state to `bytes`. */
int unit_write(unit *x, const void *saved, unsigned char *bytes, size_t n)
{
    if (unit_has(x, 1, saved, bytes)) return UNIT_ERROR;
    if (n < unit_serialized_bytes(x))
        return unit_say(x, UNIT_ERROR, "there is room for %zu bytes, but a serialized state has %zu", n, unit_serialized_bytes(x));
    const uint64_t digest = digest_of(x, saved);
    memcpy(bytes, &digest, sizeof digest);
    memcpy(bytes + sizeof digest, saved, saved_bytes(x));
    return UNIT_OK;
}

int unit_read(unit *x, const unsigned char *bytes, size_t n, void **saved)
{
    uint64_t digest;
    if (unit_has(x, n, bytes, saved)) return UNIT_ERROR;
    if (n != unit_serialized_bytes(x))
        return unit_say(x, UNIT_ERROR, "the serialized state has %zu bytes, expected %zu", n, unit_serialized_bytes(x));
    memcpy(&digest, bytes, sizeof digest);
    if (digest != digest_of(x, bytes + sizeof digest))
        return unit_say(x, UNIT_ERROR, "these bytes are not a state that this FMU has serialized");
    if (!*saved) *saved = malloc(saved_bytes(x));
    if (!*saved) return unit_say(x, UNIT_ERROR, "there is not enough memory");
    memcpy(*saved, bytes + sizeof digest, saved_bytes(x));
    return UNIT_OK;
}
