// The page: time, controls, and the loop that draws.
const $ = id => document.getElementById(id);
const replay = {
    time: 0, rate: DATA.speed, playing: false, loops: location.hash === "#looping", duration: DATA.end - DATA.start, kind: DATA.shapes, connections: true, ready: false,

    seek(time) {
        this.time = Math.max(0, Math.min(time, this.duration));
        this.draw();
    },

    play() {
        if (this.time >= this.duration) this.time = 0;
        this.playing = this.duration > 0;
        this.last = performance.now();
    },

    pause() { this.playing = false; },

    toggle() { this.playing ? this.pause() : this.play(); },

    // one frame forwards or back, or to the next or the last impact
    step(sign, impacts) {
        this.pause();
        if (!(this.duration > 0)) return;
        // just beyond this time, so that rounding leads no step to where it began
        const here = this.time + sign * 1e-9 * (1 + this.duration), times = this.impacts;
        if (!impacts) {
            const frame = sign > 0 ? Math.floor(here / this.poses.interval) + 1 : Math.ceil(here / this.poses.interval) - 1;
            return this.seek(frame * this.poses.interval);
        }
        const after = firstAbove(times, here);
        this.seek(sign > 0 ? times[after] ?? this.duration : times[after - 1] ?? 0);
    },

    draw() {
        this.poses.set(this.time);
        DRIVEN.forEach((node, c) => {
            const { position, turn } = this.poses;
            node.position.set(...position.slice(3 * c, 3 * c + 3));
            node.quaternion.set(...turn.slice(4 * c, 4 * c + 4)).normalize();
        });
        for (const group of this.groups) group.place(this.poses);
        this.marks.set(this.time, this.rate);
        if (["speed", "percussion"].includes(this.painter.mode)) this.paint();
        Trails.set(this.time);
        Camera.move();
        viewer.set_dirty();
        $("time").value = this.time;
        $("clock").textContent = `${(DATA.start + this.time).toFixed(3)} s`;
    },

    // for pictures: without controls, and not playing
    still() {
        this.autoplay = false;
        this.pause();
        for (const panel of document.querySelectorAll(".panel")) panel.hidden = true;
        Scheme.apply(false);
        Camera.view("fit");
    },

    paint() { this.painter.paint(this.time, this.rate, this.poses, this.groups); },

    choose(kind) {
        this.kind = kind;
        for (const group of this.groups) group.choose(kind);
        $("shapes").textContent = kind === 1 ? "Show collision shapes" : "Show visual shapes";
        this.paint();
        this.draw();
    },
};
const DRIVEN = [];

// light or dark, as the system is set
const Scheme = {
    colors: { true: [[0.10, 0.13, 0.18], [0.20, 0.22, 0.25]], false: [[0.66, 0.78, 0.90], [0.96, 0.96, 0.94]] },
    asked: matchMedia("(prefers-color-scheme: dark)"),

    apply(dark) {
        ["top_color", "bottom_color"].forEach((end, k) => viewer.set_property(["Background"], end, this.colors[dark][k]));
        // a gradient keeps the colors it was made of
        viewer.show_background();
    },

    follow() {
        this.apply(this.asked.matches);
        this.asked.addEventListener("change", () => this.apply(this.asked.matches));
    },
};

// Space, arrows, Home and End; what has the focus keeps the keys that mean something to it
function keys(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const acts = {
        " ": () => replay.toggle(), ArrowRight: () => replay.step(1, event.shiftKey), ArrowLeft: () => replay.step(-1, event.shiftKey),
        Home: () => { replay.pause(); replay.seek(0); }, End: () => { replay.pause(); replay.seek(replay.duration); },
    };
    if (!acts[event.key] || (event.key === " " && ["BUTTON", "INPUT"].includes(event.target.tagName) && event.target.id !== "time")) return;
    event.preventDefault();
    acts[event.key]();
}

function shortNumber(value, unit) { return `${Number(value.toPrecision(3))} ${unit}`; }

function controls() {
    $("time").max = replay.duration || 1;
    $("time").oninput = () => { replay.pause(); replay.seek(Number($("time").value)); };
    $("play").onclick = () => replay.toggle();
    const loops = () => $("loop").classList.toggle("on", replay.loops);
    $("loop").onclick = () => { replay.loops = !replay.loops; loops(); };
    loops();
    const rates = [...new Set([4, 2, 1, 0.5, 0.25, 0.1, 0.02, 0.004, DATA.speed])].sort((a, b) => b - a);
    $("speed").append(...rates.map(rate => new Option(`${rate} ×`, rate, false, rate === DATA.speed)));
    $("speed").onchange = () => { replay.rate = Number($("speed").value); replay.draw(); };
    $("color").onchange = () => {
        const mode = replay.painter.mode = $("color").value;
        $("legend").style.display = ["speed", "percussion"].includes(mode) ? "flex" : "none";
        $("largest").textContent = mode === "speed" ? shortNumber(DATA.fast, "m/s") : shortNumber(DATA.strong, "N s");
        replay.paint();
        viewer.set_dirty();
    };
    $("body").append(new Option("none", -1), ...DATA.names.map((name, k) => new Option(name, DATA.driven + k)));
    const chosen = () => Number($("body").value), state = () => {
        $("follow").classList.toggle("on", chosen() >= 0 && Camera.followed === chosen());
        $("trail").classList.toggle("on", Trails.lines.has(chosen()));
        $("follow").disabled = $("trail").disabled = chosen() < 0;
    };
    $("body").onchange = () => { replay.marks.body = chosen(); replay.draw(); state(); };
    state();
    $("follow").onclick = () => { Camera.follow(Camera.followed === chosen() ? -1 : chosen()); replay.draw(); state(); };
    $("trail").onclick = () => { Trails.toggle(chosen()); viewer.set_dirty(); state(); };
    $("shapes").onclick = () => replay.choose(3 - replay.kind);
    $("shapes").hidden = replay.groups.every(group => group.kinds.every(kind => kind === 3));
    ["percussions", "cones", "normals"].forEach((id, kind) => {
        $(id).checked = replay.marks.shown[kind];
        $(id).onchange = () => { replay.marks.shown[kind] = $(id).checked; replay.draw(); };
    });
    $("connections").onchange = () => { replay.connections = $("connections").checked; replay.choose(replay.kind); };
    $("with-connections").hidden = !replay.groups.some(group => group.connections);
    // they have no common point: their equations are listed; pages of the site may be older
    const coupled = DATA.couplings ?? [];
    $("couplings").append(...coupled.map(text => Object.assign(document.createElement("div"), { textContent: text })));
    $("couplings").hidden = !coupled.length;
    if (!DATA.frictional) $("with-friction").style.display = $("regimes").style.display = "none";
    for (const button of document.querySelectorAll("[data-view]")) button.onclick = () => Camera.view(button.dataset.view);
    const small = () => innerWidth < 560 || innerHeight < 420;
    $("more").onclick = () => { $("options").hidden = !$("options").hidden; $("more").classList.toggle("on", !$("options").hidden); };
    addEventListener("keydown", keys);
    // embedded in another page, it is small
    if (!small() && !replay.loops) $("more").classList.add("on"); else $("options").hidden = true;
}

function loop(now) {
    if (replay.playing) {
        replay.time += replay.rate * Math.max(0, now - replay.last) / 1000;
        replay.last = now;
        if (replay.time >= replay.duration && replay.loops) replay.time %= replay.duration;
        else if (replay.time >= replay.duration) { replay.time = replay.duration; replay.pause(); }
        replay.draw();
    }
    $("play").textContent = replay.playing ? "Pause" : "Play";
    requestAnimationFrame(loop);
}

(async () => {
    for (const command of COMMANDS) viewer.handle_command_bytearray(bytesOf(command));
    const root = viewer.scene_tree.find(["meshcat"]).object;
    root.scale.setScalar(1 / DATA.radius);
    root.position.set(...CENTRE.map(x => -x / DATA.radius));
    replay.poses = await Poses.decoded();
    replay.groups = await Promise.all(DATA.groups.map((_, k) => Group.decoded(k)));
    replay.marks = await Marks.decoded();
    replay.painter = await Painter.decoded();
    for (let k = 0; k < DATA.driven; k++) DRIVEN.push(viewer.scene_tree.find(["meshcat", "driven", String(k)]).object);
    replay.impacts = new Float64Array(await inflated(DATA.impacts));
    Scheme.follow();
    controls();
    replay.choose(DATA.shapes);
    Camera.view("fit");
    replay.ready = true;
    addEventListener("resize", () => Camera.lift());
    requestAnimationFrame(loop);
    // the first picture takes long: time starts after it
    requestAnimationFrame(() => requestAnimationFrame(() => replay.autoplay === false || replay.play()));
})();
