"use strict";
(function () {
  document.documentElement.classList.add("js");
  const at = (id) => document.getElementById(id);
  const viewer = at("viewer");

  function view(title, source, text, plot) {
    at("viewer-title").textContent = title;
    at("viewer-text").textContent = text;
    const frame = viewer.querySelector(".frame");
    frame.textContent = "";
    frame.classList.toggle("plot", Boolean(plot));
    if (source) { frame.append(Object.assign(new Image(), { src: source, alt: title || text })); }
    if (!viewer.open) { viewer.showModal(); }
  }
  viewer.addEventListener("click", (event) => { if (event.target === viewer) { viewer.close(); } });

  at("print").addEventListener("click", () => window.print());
  let folded = [];
  window.addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll("details:not([open])")];
    folded.forEach((part) => { part.open = true; });
  });
  window.addEventListener("afterprint", () => folded.forEach((part) => { part.open = false; }));

  /* A link to a folded section opens it. */
  function unfold() {
    const goal = location.hash ? at(location.hash.slice(1)) : null;
    const part = goal && goal.querySelector("details");
    if (part) { part.open = true; }
  }
  window.addEventListener("hashchange", unfold);
  unfold();

  /* A picture is pressed like a button: by pointer, finger, Enter or the space bar. */
  function pressed(image, open) {
    image.tabIndex = 0;
    image.setAttribute("role", "button");
    image.addEventListener("click", open);
    image.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); open(); }
    });
  }
  for (const image of document.querySelectorAll("figure img")) {
    pressed(image, () => view("", image.src, image.alt, true));
  }
  for (const image of document.querySelectorAll(".card img[data-moving]")) {
    const still = image.src, moving = image.dataset.moving;
    for (const kind of ["pointerenter", "focus"]) { image.addEventListener(kind, () => { image.src = moving; }); }
    for (const kind of ["pointerleave", "blur"]) { image.addEventListener(kind, () => { image.src = still; }); }
    pressed(image, () => {
      const card = image.parentElement;
      const facts = [...card.querySelectorAll("dl div")];
      view(card.querySelector("h3").textContent, moving,
        facts.map((row) => row.children[0].textContent + ": " + row.children[1].textContent).join("\n"));
    });
  }

  if (at("map-data")) { squealMap(JSON.parse(at("map-data").textContent)); }

  function squealMap(data) {
    const svg = at("map-plot"), tip = at("map-tip"), space = svg.namespaceURI;
    const linear = 1e-4, edge = { left: 64, right: 12, top: 10, bottom: 40 };
    const count = data.frequency.length;
    const order = [...Array(count).keys()].sort((i, j) => data.frequency[i] - data.frequency[j]);
    const scaled = (d) => Math.abs(d) <= linear ? 0.6 * d / linear
      : Math.sign(d) * (0.6 + Math.log10(Math.abs(d) / linear));
    const finite = (d) => d === null ? 0 : d;
    let most = 0.01, least = -0.01, top = 1;
    for (let i = 0; i < count; i += 1) {
      most = Math.max(most, finite(data.damping[i]));
      least = Math.min(least, finite(data.damping[i]));
      top = Math.max(top, data.frequency[i]);
    }
    const range = [scaled(least) - 0.25, scaled(most) + 0.25];
    const filter = { approach: at("map-approach"), family: at("map-family"), threshold: at("map-threshold") };
    let shown = [], place = { x: [], y: [] }, chosen = -1;

    const limit = () => Math.max(0, Number(filter.threshold.value) || 0);
    const squeals = (i) => data.verdict[i] === 1 && data.damping[i] !== null && data.damping[i] < -limit();
    const family = (i) => data.families[data.approach[i] + ":" + data.family[i]];

    function listFamilies() {
      const old = filter.family.value, only = filter.approach.value;
      filter.family.textContent = "";
      filter.family.append(new Option("all", ""));
      for (const [key, value] of Object.entries(data.families)) {
        const approach = key.split(":")[0];
        if (only === "" || only === approach) {
          const name = only === "" && data.names.length > 1 ? data.names[approach] + ", " : "";
          filter.family.append(new Option(name + value.khz + " kHz (" + value.share + ")", key));
        }
      }
      filter.family.value = [...filter.family.options].some((o) => o.value === old) ? old : "";
    }

    function make(name, attributes, text) {
      const node = document.createElementNS(space, name);
      for (const [key, value] of Object.entries(attributes)) { node.setAttribute(key, value); }
      if (text !== undefined) { node.textContent = text; }
      svg.append(node);
      return node;
    }

    function draw() {
      const width = svg.clientWidth, height = svg.clientHeight;
      if (!width) { return; }
      svg.setAttribute("viewBox", "0 0 " + width + " " + height);
      svg.textContent = "";
      const right = width - edge.right, bottom = height - edge.bottom;
      const x = (f) => edge.left + (right - edge.left) * f / (1.02 * top);
      const y = (d) => bottom - (bottom - edge.top) * (scaled(d) - range[0]) / (range[1] - range[0]);
      const line = Math.min(Math.max(y(-limit()), edge.top), bottom);
      make("rect", { x: edge.left, y: line, width: right - edge.left, height: bottom - line, fill: "#fbeee6" });
      for (const d of [-1, -0.1, -0.01, -0.001, 0, 0.001, 0.01, 0.1, 1]) {
        if (scaled(d) < range[0] || scaled(d) > range[1]) { continue; }
        make("line", { x1: edge.left, x2: right, y1: y(d), y2: y(d), stroke: d ? "#ddd" : "#1a1a1a", "stroke-width": 0.8 });
        make("text", { x: edge.left - 6, y: y(d) + 4, "text-anchor": "end" }, String(d).replace("-", "\u2212"));
      }
      const step = [50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 2e4].find((s) => x(s) - x(0) > 48) || 5e4;
      for (let f = 0; f <= 1.02 * top; f += step) {
        make("line", { x1: x(f), x2: x(f), y1: bottom, y2: bottom + 4, stroke: "#1a1a1a" });
        make("text", { x: x(f), y: bottom + 17, "text-anchor": "middle" }, String(f / 1e3));
      }
      make("line", { x1: edge.left, x2: right, y1: bottom, y2: bottom, stroke: "#1a1a1a" });
      make("text", { x: (edge.left + right) / 2, y: height - 6, "text-anchor": "middle" }, "frequency [kHz]");
      const middle = (edge.top + bottom) / 2;
      make("text", { x: 13, y: middle, "text-anchor": "middle", transform: "rotate(-90 13 " + middle + ")" },
        "damping \u22122 \u03b1 / |\u03c9| [-]");

      const paths = { other: "", stable: "", neutral: "", unstable: "", squeal: "" };
      const own = { approach: filter.approach.value, family: filter.family.value };
      const samples = new Set();
      let hits = 0;
      shown = [];
      place = { x: new Float64Array(count), y: new Float64Array(count) };
      for (const i of order) {
        if (own.approach !== "" && data.approach[i] !== Number(own.approach)) { continue; }
        place.x[i] = x(data.frequency[i]);
        place.y[i] = y(data.damping[i] === null ? least : data.damping[i]);
        const inside = own.family === "" || own.family === data.approach[i] + ":" + data.family[i];
        if (inside) { shown.push(i); }
        const kind = !inside ? "other" : squeals(i) ? "squeal" : ["stable", "unstable", "neutral"][data.verdict[i]];
        if (kind === "squeal") { hits += 1; samples.add(data.approach[i] + ":" + data.sample[i]); }
        paths[kind] += "M" + place.x[i].toFixed(1) + " " + place.y[i].toFixed(1) + "h.01";
      }
      const many = shown.length > 3000;
      const colours = { other: "#e4e4e4", stable: "#0072B2", neutral: "#000000", unstable: "#8a8a8a", squeal: "#D55E00" };
      for (const [kind, path] of Object.entries(paths)) {
        if (!path) { continue; }
        make("path", { d: path, fill: "none", stroke: colours[kind], "stroke-linecap": "round",
          "stroke-width": many ? 4 : 6.5, "stroke-opacity": many ? 0.5 : 0.8, "class": kind });
      }
      const counted = (n, what) => n + " " + what + (n === 1 ? "" : "s");
      at("map-count").textContent = counted(hits, "squeal mode") + " in " + counted(samples.size, "sample")
        + (data.thinned ? " (of the modes shown)" : "");
      mark(shown.includes(chosen) ? chosen : -1);
    }

    function numbers(i) {
      const d = data.damping[i] === null ? "\u2212\u221e" : data.damping[i].toPrecision(3).replace("-", "\u2212");
      const lines = [(data.frequency[i] / 1e3).toFixed(3) + " kHz, damping " + d,
        data.names[data.approach[i]] + ", sample " + data.sample[i] + ", mode " + data.mode[i],
        squeals(i) ? "squeal" : ["stable", "unstable, no squeal", "neutral"][data.verdict[i]],
        data.family[i] < 0 ? "no family" : "family " + data.family[i] + (family(i) ? ": squeals in " + family(i).share : "")];
      if (data.partner[i] >= 0) { lines.push("partner: mode " + data.partner[i]); }
      lines.push("relative error of the eigenvalue " + (data.error[i] === null ? "not known" : data.error[i].toExponential(1)));
      return lines;
    }

    function mark(i) {
      chosen = i;
      svg.querySelectorAll(".ring").forEach((ring) => ring.remove());
      tip.style.display = i < 0 ? "none" : "block";
      if (i < 0) { return; }
      make("circle", { cx: place.x[i], cy: place.y[i], r: 7, fill: "none", stroke: "#000", "stroke-width": 1.5, "class": "ring" });
      tip.textContent = numbers(i).join("\n");
      const width = svg.clientWidth, left = place.x[i] + 14;
      tip.style.left = Math.max(0, left + tip.offsetWidth > width ? Math.min(place.x[i] - 14, width) - tip.offsetWidth : left) + "px";
      tip.style.top = Math.max(0, place.y[i] - tip.offsetHeight - 8) + "px";
    }

    function nearest(event) {
      const box = svg.getBoundingClientRect();
      const x = event.clientX - box.left, y = event.clientY - box.top;
      let best = -1, least = event.pointerType === "touch" ? 28 * 28 : 14 * 14;
      for (const i of shown) {
        const away = (place.x[i] - x) ** 2 + (place.y[i] - y) ** 2;
        if (away < least) { least = away; best = i; }
      }
      return best;
    }

    function show(i) {
      if (i < 0) { return; }
      const found = data.shapes[data.approach[i] + ":" + data.sample[i] + ":" + data.mode[i]] || (family(i) || {}).shape;
      const image = found ? at("shape-" + found) : null;
      const same = found && found === data.shapes[data.approach[i] + ":" + data.sample[i] + ":" + data.mode[i]];
      const said = image ? (same ? "The shape of this mode." : "The shape of the mode of this family with median damping.")
        : "No picture of this mode: shapes are drawn for the most severe families of each approach.";
      view(numbers(i)[0], image && (image.dataset.moving || image.src), [...numbers(i).slice(1), said].join("\n"));
    }

    svg.addEventListener("pointermove", (event) => mark(nearest(event)));
    svg.addEventListener("pointerleave", () => mark(-1));
    svg.addEventListener("click", (event) => { mark(nearest(event)); show(chosen); });
    svg.addEventListener("keydown", (event) => {
      const now = shown.indexOf(chosen), last = shown.length - 1;
      const next = { ArrowRight: now < last ? now + 1 : 0, ArrowLeft: now > 0 ? now - 1 : last, Home: 0, End: last }[event.key];
      if (next !== undefined && shown.length) {
        mark(shown[next]);
        event.preventDefault();
      } else if (event.key === "Enter" || event.key === " ") {
        /* Or the key would press the button of the dialog that opens. */
        event.preventDefault();
        show(chosen);
      }
    });
    filter.approach.addEventListener("change", () => { listFamilies(); draw(); });
    filter.family.addEventListener("change", draw);
    filter.threshold.addEventListener("input", draw);
    window.addEventListener("resize", draw);
    listFamilies();
    draw();
  }
})();
