// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Client of JACK with the world of sound_world.py, which tells all numbers: in C, as Python misses
// blocks on a busy machine. JACK's own headers are not needed.

#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct client client;
typedef struct port port;
client *jack_client_open(const char *name, int options, int *status, ...);
port *jack_port_register(client *, const char *name, const char *type, unsigned long flags,
                         unsigned long size);
void *jack_port_get_buffer(port *, uint32_t frames);
int jack_set_process_callback(client *, int (*)(uint32_t, void *), void *);
int jack_activate(client *);
const char **jack_get_ports(client *, const char *name, const char *type, unsigned long flags);
const char *jack_port_name(const port *);
int jack_connect(client *, const char *source, const char *target);
void jack_free(void *);

enum { IS_INPUT = 1, IS_OUTPUT = 2, MOST = 8 };
static const char AUDIO[] = "32 bit float mono audio";

typedef struct { // second-order sections of a filter
    int count;
    double sections[MOST][6], states[MOST][2];
} filter;

typedef struct { // samples that repeat
    uint32_t count;
    double *samples;
} loop;

static filter handle, coupling[2];
static loop texture, noise[2];
static double full_scale, scale, polarity, tap;
static volatile sig_atomic_t tapped;
static int tap_frames, frames_left;
static uint64_t now;
static client *jack;
static port *force, *sensors[2];

static double filtered(filter *f, double x) {
    for (int i = 0; i < f->count; i++) {
        double *c = f->sections[i], *z = f->states[i], y = c[0] * x + z[0];
        z[0] = c[1] * x - c[4] * y + z[1];
        z[1] = c[2] * x - c[5] * y;
        x = y;
    }
    return x;
}

static int process(uint32_t frames, void *unused) {
    (void)unused;
    float *in = jack_port_get_buffer(force, frames), *out[2];
    for (int i = 0; i < 2; i++)
        out[i] = jack_port_get_buffer(sensors[i], frames);
    if (tapped) {
        tapped = 0;
        frames_left = tap_frames;
    }
    for (uint32_t n = 0; n < frames; n++, now++) {
        double hit = frames_left > 0 ? (frames_left--, tap) : 0.0;
        double moved[2] = {filtered(&handle, full_scale * in[n]),
                           texture.samples[now % texture.count]};
        for (int i = 0; i < 2; i++) {
            double measured = hit + moved[i] + noise[i].samples[now % noise[i].count];
            double passed = filtered(&coupling[i], measured) / scale;
            out[i][n] = (float)((i ? 1.0 : polarity) * passed);
        }
    }
    return 0;
}

static double number(FILE *file) {
    double value;
    if (fscanf(file, "%lf", &value) != 1)
        exit(2);
    return value;
}

static void read_filter(FILE *file, filter *f) {
    f->count = (int)number(file);
    for (int i = 0; i < f->count; i++)
        for (int j = 0; j < 6; j++)
            f->sections[i][j] = number(file);
}

static void read_loop(FILE *file, loop *l) {
    l->count = (uint32_t)number(file);
    l->samples = malloc(l->count * sizeof(double));
    for (uint32_t i = 0; i < l->count; i++)
        l->samples[i] = number(file);
}

static void on_tap(int unused) {
    (void)unused;
    tapped = 1;
}

// Connect to what PortAudio has opened; it numbers its ports on and on.
static void connect_all(void) {
    const char **outs = jack_get_ports(jack, "^PortAudio", AUDIO, IS_OUTPUT);
    const char **ins = jack_get_ports(jack, "^PortAudio", AUDIO, IS_INPUT);
    if (outs && outs[0])
        jack_connect(jack, outs[0], jack_port_name(force));
    for (int i = 0; i < 2 && ins && ins[i]; i++)
        jack_connect(jack, jack_port_name(sensors[i]), ins[i]);
    jack_free(outs);
    jack_free(ins);
}

int main(void) {
    full_scale = number(stdin), scale = number(stdin), polarity = number(stdin);
    tap = number(stdin), tap_frames = (int)number(stdin);
    read_filter(stdin, &handle);
    for (int i = 0; i < 2; i++)
        read_filter(stdin, &coupling[i]);
    read_loop(stdin, &texture);
    for (int i = 0; i < 2; i++)
        read_loop(stdin, &noise[i]);
    signal(SIGUSR1, on_tap);
    jack = jack_client_open("world", 1, NULL);  // without starting a server
    if (!jack)
        return 1;
    force = jack_port_register(jack, "force", AUDIO, IS_INPUT, 0);
    sensors[0] = jack_port_register(jack, "handle", AUDIO, IS_OUTPUT, 0);
    sensors[1] = jack_port_register(jack, "tool", AUDIO, IS_OUTPUT, 0);
    jack_set_process_callback(jack, process, NULL);
    if (jack_activate(jack))
        return 1;
    puts("ready");
    fflush(stdout);
    for (;;) {
        connect_all();
        usleep(100000);
    }
}
