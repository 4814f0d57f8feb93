// Replay of rotor, tower and wake on a canvas. The page holds one element ".replay" and its data as JSON; see
// wt_gym/analysis/report.py for the format. Coordinates: x downwind, y left, z up, meters.
(function () {
  'use strict';
  const root = document.querySelector('.replay');
  if (!root) return;
  const data = JSON.parse(document.getElementById('replay-data').textContent);
  const find = (name) => root.querySelector('[data-part="' + name + '"]');
  const canvas = find('scene'), charts = find('charts'), slider = find('time'), playButton = find('play');
  const scheme = (name) => getComputedStyle(document.documentElement).getPropertyValue('--' + name);
  const BLADES = ['#ffd166', '#7ee0c3', '#f7a1c4'];
  const VIEWS = {
    oblique: [-0.95, 0.22], side: [-Math.PI / 2, 0.04], front: [-Math.PI, 0.04], above: [-Math.PI / 2, 1.35],
  };
  // The wake drifts a little slower than the wind; between two frames its nodes are carried along with this share.
  const DRIFT = 0.85;

  function decode(entry) {
    const bytes = Uint8Array.from(atob(entry.data), (c) => c.charCodeAt(0));
    const raw = entry.bits === 8 ? new Int8Array(bytes.buffer) : new Int16Array(bytes.buffer);
    const full = 2 ** (entry.bits - 1) - 1, values = new Float32Array(raw.length);
    for (let i = 0; i < raw.length; i++) {
      values[i] = raw[i] < -full ? NaN : entry.offset + entry.scale * raw[i] / full;
    }
    return {values, shape: entry.shape, size: entry.shape.slice(1).reduce((a, b) => a * b, 1)};
  }

  const agents = data.agents.map((agent) => {
    const shapes = {};
    for (const name of Object.keys(agent.shapes)) shapes[name] = decode(agent.shapes[name]);
    const strongest = shapes.strength.values.reduce((a, b) => (b > a ? b : a), 1e-9);
    return Object.assign({}, agent, {shapes, strongest});
  });
  let current = agents[data.open], position = 0, playing = false, last = null, speed = 1;
  let [azimuth, elevation] = VIEWS.oblique, zoom = 1;

  // ---------------------------------------------------------------- scene
  function camera(width, height) {
    const reach = data.size, high = data.sea ? 3.4 : 3.2;  // with what is below a sea, or the marks on the ground
    const scale = zoom * Math.min(height / (high * reach), width / (3.6 * reach));
    const center = [0.75 * reach, 0, 0.75 * data.hub_height];
    const ca = Math.cos(azimuth), sa = Math.sin(azimuth), ce = Math.cos(elevation), se = Math.sin(elevation);
    const distance = (data.sea ? 24 : 9) * reach;  // anchors are farther from the tower than the ends of a wake
    return function (x, y, z) {
      const dx = x - center[0], dy = y - center[1], dz = z - center[2];
      const right = -sa * dx + ca * dy, ahead = -(ca * dx + sa * dy);
      const depth = ce * ahead - se * dz, up = se * ahead + ce * dz;
      const k = scale * distance / Math.max(distance + depth, 0.2 * distance);
      return [width / 2 + k * right, height / 2 - k * up, depth, k];
    };
  }

  function mixed(shape, frame, a, index) {
    const i = frame * shape.size + index, j = Math.min(frame + 1, shape.shape[0] - 1) * shape.size + index;
    return (1 - a) * shape.values[i] + a * shape.values[j];
  }

  function wakeColor(weight) {
    return 'rgba(' + Math.round(90 + 150 * weight) + ',' + Math.round(170 + 75 * weight) + ',' +
      Math.round(225 + 30 * weight) + ',' + (0.08 + 0.87 * weight).toFixed(3) + ')';
  }

  // Control points of the curve from p to q between the nodes before and behind: it passes through all nodes, and its
  // direction at each takes account of how far apart they are.
  function bend(before, p, q, behind) {
    const span = (a, b) => Math.hypot(b[0] - a[0], b[1] - a[1]) || 1e-9, d = span(p, q);
    const first = before ? d / (3 * (span(before, p) + d)) : 0, last = behind ? d / (3 * (d + span(q, behind))) : 0;
    return [0, 1].map((k) => [
      before ? p[k] + first * (q[k] - before[k]) : p[k] + (q[k] - p[k]) / 3,
      behind ? q[k] - last * (behind[k] - p[k]) : q[k] - (q[k] - p[k]) / 3,
    ]);
  }

  function addWake(items, project, frame, a) {
    const {wake, strength} = current.shapes, [, rows, blades, filaments] = wake.shape;
    const shift = a * DRIFT * data.dt * current.signals.wind[frame];
    for (let b = 0; b < blades; b++) {
      for (let f = 0; f < filaments; f++) {
        // tip vortices first: those of the roots are as strong, and hide them
        const share = f / Math.max(1, filaments - 1), place = 0.25 + 0.75 * Math.min(1, Math.max(0, (share - 0.5) / 0.35));
        const points = [];
        for (let r = 0; r < rows; r++) {
          const node = (r * blades + b) * filaments + f, k = 3 * node;
          const start = frame * wake.size + k;
          if (Number.isNaN(wake.values[start])) break;
          const point = r === 0
            ? project(mixed(wake, frame, a, k), mixed(wake, frame, a, k + 1), mixed(wake, frame, a, k + 2))
            : project(wake.values[start] + shift, wake.values[start + 1], wake.values[start + 2]);
          points.push(point);
        }
        for (let r = 1; r < points.length; r++) {
          const node = ((r - 1) * blades + b) * filaments + f, p = points[r - 1], q = points[r];
          const s = Math.min(1, strength.values[frame * strength.size + node] / current.strongest);
          const weight = Math.sqrt(s) * place * Math.min(1, 1.8 * (1 - r / points.length));
          if (weight < 0.05) continue;
          items.push({
            depth: 0.5 * (p[2] + q[2]), line: [p, q], curve: bend(points[r - 2], p, q, points[r + 1]),
            color: wakeColor(weight), width: 0.5 + 1.9 * weight,
          });
        }
      }
    }
  }

  function quad(items, corners, color, edge) {
    items.push({depth: corners.reduce((sum, c) => sum + c[2], 0) / corners.length, face: corners, color, edge});
  }

  // A column from p to q with radii there.
  function column(items, p, q, first, last, color) {
    const rp = first * p[3], rq = last * q[3];
    const nx = -(q[1] - p[1]), ny = q[0] - p[0], length = Math.hypot(nx, ny) || 1, ux = nx / length, uy = ny / length;
    quad(items, [[p[0] - ux * rp, p[1] - uy * rp, p[2]], [p[0] + ux * rp, p[1] + uy * rp, p[2]],
      [q[0] + ux * rq, q[1] + uy * rq, q[2]], [q[0] - ux * rq, q[1] - uy * rq, q[2]]], color, color);
  }

  // A cylinder between two points, with its ends, darker below still water.
  function member(items, project, [low, high], radius) {
    if (low[2] > high[2]) [low, high] = [high, low];
    const share = low[2] / (low[2] - high[2]), edge = low.map((value, k) => value + share * (high[k] - value));
    const parts = low[2] < 0 && high[2] > 0 ? [[low, edge], [edge, high]] : [[low, high]];
    const axis = high.map((value, k) => value - low[k]), length = Math.hypot(...axis), upright = Math.hypot(axis[0], axis[1]) < 0.5 * length;
    const first = upright ? [1, 0, 0] : [0, 0, 1], dot = first.reduce((sum, value, k) => sum + value * axis[k], 0) / length ** 2;
    const across = first.map((value, k) => value - dot * axis[k]), size = Math.hypot(...across), e = across.map((value) => radius * value / size);
    const f = [0, 1, 2].map((k) => (axis[(k + 1) % 3] * e[(k + 2) % 3] - axis[(k + 2) % 3] * e[(k + 1) % 3]) / length);
    const ring = (center) => Array.from({length: 24}, (_, n) => project(...center.map(
      (value, k) => value + Math.cos(n * Math.PI / 12) * e[k] + Math.sin(n * Math.PI / 12) * f[k])));
    for (const [from, to] of parts) {
      const wet = to[2] <= 0, color = wet ? '#4d6f8c' : '#7b909f';
      for (const end of [from, to]) quad(items, ring(end), wet ? '#5b7f9c' : '#8da1af', color);
      column(items, project(...from), project(...to), radius, radius, color);
    }
  }

  function addTurbine(items, project, frame, a) {
    const {tower, hub, blades} = current.shapes, point = (shape, index) => project(
      mixed(shape, frame, a, index), mixed(shape, frame, a, index + 1), mixed(shape, frame, a, index + 2));
    const n = tower.shape[1];
    for (let i = 0; i + 1 < n; i++) {
      column(items, point(tower, 3 * i), point(tower, 3 * i + 3), data.tower_radius[i], data.tower_radius[i + 1], '#8fa3b3');
    }
    const {floater} = current.shapes;
    for (let i = 0; i < floater.shape[1]; i++) {
      const radius = data.floater_radius[i];
      if (radius > 0) member(items, project, [6 * i, 6 * i + 3].map((k) => [0, 1, 2].map((j) => mixed(floater, frame, a, k + j))), radius);
      else {
        const p = point(floater, 6 * i), q = point(floater, 6 * i + 3);
        items.push({depth: 0.5 * (p[2] + q[2]), line: [p, q], color: '#7d8f9d', width: 1.4});
      }
    }
    const nose = point(hub, 0), top = point(tower, 3 * (n - 1));
    // as far behind the tower axis as the hub is before it, at the height of the hub
    const at = (shape, index) => mixed(shape, frame, a, index), end = 3 * (n - 1);
    const tail = project(2 * at(tower, end) - at(hub, 0), 2 * at(tower, end + 1) - at(hub, 1), at(hub, 2) - 0.5);
    items.push({depth: top[2], line: [nose, tail], color: '#b9c6d1', width: 2 * data.tower_radius[n - 1] * top[3]});
    items.push({depth: nose[2], disc: nose, radius: 0.9 * data.tower_radius[n - 1] * nose[3], color: '#dfe7ee'});
    const [, count, , spans] = blades.shape;
    for (let b = 0; b < count; b++) {
      const edge = (side, s) => point(blades, 3 * ((2 * b + side) * spans + s));
      quad(items, [nose, edge(0, 0), edge(1, 0)], '#c8d4dd', '#c8d4dd');
      for (let s = 0; s + 1 < spans; s++) {
        quad(items, [edge(0, s), edge(0, s + 1), edge(1, s + 1), edge(1, s)], '#f5f8fa', BLADES[b % BLADES.length]);
      }
    }
  }

  // The circle of the tips, a little brighter than the sky.
  function rotorDisc(context, project, frame, a) {
    const {blades, hub} = current.shapes, [, count, , spans] = blades.shape, tips = [];
    for (let b = 0; b < count; b++) {
      const at = 3 * ((2 * b) * spans + spans - 1);
      tips.push([0, 1, 2].map((k) => mixed(blades, frame, a, at + k)));
    }
    if (count < 3) return;
    const center = [0, 1, 2].map((k) => tips.reduce((sum, tip) => sum + tip[k], 0) / count);
    const radius = Math.hypot(...[0, 1, 2].map((k) => tips[0][k] - center[k]));
    const e1 = [0, 1, 2].map((k) => (tips[0][k] - center[k]) / radius), e = [0, 1, 2].map((k) => tips[1][k] - center[k]);
    const along = e.reduce((sum, value, k) => sum + value * e1[k], 0), rest = e.map((value, k) => value - along * e1[k]);
    const size = Math.hypot(...rest), e2 = rest.map((value) => value / size);
    context.beginPath();
    for (let i = 0; i <= 72; i++) {
      const c = radius * Math.cos(i * Math.PI / 36), s = radius * Math.sin(i * Math.PI / 36);
      const p = project(...[0, 1, 2].map((k) => center[k] + c * e1[k] + s * e2[k]));
      if (i) context.lineTo(p[0], p[1]); else context.moveTo(p[0], p[1]);
    }
    context.fillStyle = 'rgba(150,200,230,.07)';
    context.fill();
    context.strokeStyle = 'rgba(150,200,230,.35)';
    context.stroke();
  }

  // Distances downwind on the ground, in rotor diameters.
  function scaleMarks(context, project) {
    const d = 2 * data.size, along = project(2 * d, 0, 0)[0] - project(d, 0, 0)[0];
    if (Math.abs(along) < 40) return;  // seen along the wind they hide each other
    context.textAlign = 'center';
    for (let k = 1; k <= 2; k++) {
      const p = project(k * d, -0.08 * d, 0), q = project(k * d, 0.08 * d, 0);
      context.beginPath();
      context.moveTo(p[0], p[1]);
      context.lineTo(q[0], q[1]);
      context.stroke();
      context.fillText(k === 1 ? '1 D = ' + d.toFixed(0) + ' m' : k + ' D', p[0], p[1] + 14);
    }
  }

  // Surface of the sea, lighter where it is high: from the darkest to the lightest are 0.02 rotor diameters.
  function sea(context, project, frame, a) {
    const faces = [], nodes = data.sea_place.map((row, i) => row.map(([x, y], j) => {
      const level = mixed(current.shapes.sea, frame, a, i * row.length + j);
      return [...project(x, y, level), level];
    }));
    const mean = (corners, k) => corners.reduce((sum, p) => sum + p[k], 0) / 4;
    for (let i = 0; i + 1 < nodes.length; i++) {
      for (let j = 0; j + 1 < nodes[i].length; j++) {
        faces.push([nodes[i][j], nodes[i + 1][j], nodes[i + 1][j + 1], nodes[i][j + 1]]);
      }
    }
    faces.sort((p, q) => mean(q, 2) - mean(p, 2));
    for (const face of faces) {
      const high = Math.min(1, Math.max(0, 0.5 + mean(face, 4) / (0.04 * data.size)));
      context.fillStyle = context.strokeStyle = 'rgb(' + [14 + 40 * high, 52 + 64 * high, 84 + 72 * high].map(Math.round) + ')';
      context.lineWidth = 1;
      context.beginPath();
      face.forEach((p, k) => (k ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
      context.closePath();
      context.fill();
      context.stroke();
    }
  }

  function ground(context, project, frame, a) {
    if (data.sea_place.length) sea(context, project, frame, a);
    else {
      context.beginPath();
      for (let k = 0; k <= 72; k++) {
        const p = project(1.2 * data.size + 2.4 * data.size * Math.cos(k * Math.PI / 36), 1.2 * data.size * Math.sin(k * Math.PI / 36), 0);
        if (k) context.lineTo(p[0], p[1]); else context.moveTo(p[0], p[1]);
      }
      context.fillStyle = 'rgba(140,170,150,.10)';
      context.fill();
    }
    context.strokeStyle = 'rgba(140,170,190,.28)';
    context.fillStyle = data.sea ? 'rgba(215,232,244,.85)' : 'rgba(140,170,190,.55)';
    context.lineWidth = 1;
    context.font = '12px Inter, "Segoe UI", Roboto, Arial, sans-serif';
    for (const share of [0.5, 1]) {
      context.beginPath();
      for (let k = 0; k <= 72; k++) {
        const p = project(share * data.size * Math.cos(k * Math.PI / 36), share * data.size * Math.sin(k * Math.PI / 36), 0);
        if (k) context.lineTo(p[0], p[1]); else context.moveTo(p[0], p[1]);
      }
      context.stroke();
    }
    const from = project(-0.95 * data.size, 0, 0), to = project(-0.6 * data.size, 0, 0);
    const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
    if (length < 12) return;
    context.strokeStyle = context.fillStyle;
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.moveTo(to[0] - (8 * dx - 5 * dy) / length, to[1] - (8 * dy + 5 * dx) / length);
    context.lineTo(to[0], to[1]);
    context.lineTo(to[0] - (8 * dx + 5 * dy) / length, to[1] - (8 * dy - 5 * dx) / length);
    context.stroke();
    context.textAlign = 'center';
    context.fillText('wind', (from[0] + to[0]) / 2, Math.max(from[1], to[1]) + 18);
  }

  function sized(element) {
    const ratio = window.devicePixelRatio || 1, width = element.clientWidth, height = element.clientHeight;
    if (element.width !== Math.round(ratio * width) || element.height !== Math.round(ratio * height)) {
      element.width = Math.round(ratio * width);
      element.height = Math.round(ratio * height);
    }
    const context = element.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return [context, width, height];
  }

  function drawScene(frame, a) {
    const [context, width, height] = sized(canvas), project = camera(width, height), items = [];
    ground(context, project, frame, a);
    scaleMarks(context, project);
    rotorDisc(context, project, frame, a);
    addWake(items, project, frame, a);
    addTurbine(items, project, frame, a);
    items.sort((p, q) => q.depth - p.depth);
    context.lineCap = 'round';
    context.lineJoin = 'round';
    for (const item of items) {
      context.beginPath();
      if (item.line) {
        context.strokeStyle = item.color;
        context.lineWidth = item.width;
        context.moveTo(item.line[0][0], item.line[0][1]);
        if (item.curve) {
          const [[x1, x2], [y1, y2]] = item.curve;
          context.bezierCurveTo(x1, y1, x2, y2, item.line[1][0], item.line[1][1]);
        } else context.lineTo(item.line[1][0], item.line[1][1]);
        context.stroke();
      } else if (item.disc) {
        context.fillStyle = item.color;
        context.arc(item.disc[0], item.disc[1], item.radius, 0, 2 * Math.PI);
        context.fill();
      } else {
        item.face.forEach((p, k) => (k ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
        context.closePath();
        context.fillStyle = item.color;
        context.fill();
        context.strokeStyle = item.edge;
        context.lineWidth = 0.8;
        context.stroke();
      }
    }
  }

  // ---------------------------------------------------------------- signals
  const ROWS = [['tip', 'Tip deflection downwind [m]'], ['pitch', 'Pitch [deg]']];

  function limits(name) {
    let low = Infinity, high = -Infinity;
    for (const agent of agents) {
      for (const blade of agent.signals[name]) {
        for (const value of blade) { low = Math.min(low, value); high = Math.max(high, value); }
      }
    }
    const margin = 0.08 * (high - low) + 1e-3;
    return [low - margin, high + margin];
  }
  const RANGES = Object.fromEntries(ROWS.map(([name]) => [name, limits(name)]));

  function drawCharts(frame, a) {
    const [context, width, height] = sized(charts), left = 40, step = height / ROWS.length;
    const count = current.time.length, across = (k) => left + (width - left - 8) * k / Math.max(1, data.frames - 1);
    context.font = '12px Inter, "Segoe UI", Roboto, Arial, sans-serif';
    ROWS.forEach(([name, title], row) => {
      const top = row * step + 22, bottom = (row + 1) * step - 8, [low, high] = RANGES[name];
      const up = (value) => bottom - (bottom - top) * (value - low) / (high - low);
      context.fillStyle = scheme('muted');
      context.textAlign = 'left';
      context.fillText(title, left, top - 8);
      context.textAlign = 'right';
      context.strokeStyle = scheme('line');
      context.lineWidth = 1;
      for (const value of [low + 0.1 * (high - low), high - 0.1 * (high - low)]) {
        context.fillText(value.toFixed(1), left - 6, up(value) + 4);
        context.beginPath();
        context.moveTo(left, up(value));
        context.lineTo(width - 8, up(value));
        context.stroke();
      }
      current.signals[name].forEach((values, b) => {
        context.strokeStyle = ['#c98a00', '#0b8f6a', '#b8487c'][b % 3];
        context.lineWidth = 1.4;
        context.beginPath();
        values.forEach((value, k) => (k ? context.lineTo(across(k), up(value)) : context.moveTo(across(k), up(value))));
        context.stroke();
      });
      context.strokeStyle = scheme('ink');
      context.beginPath();
      context.moveTo(across(Math.min(frame + a, count - 1)), top);
      context.lineTo(across(Math.min(frame + a, count - 1)), bottom);
      context.stroke();
    });
  }

  function showNumbers(frame) {
    const s = current.signals, at = (values) => values[frame];
    find('clock').textContent = current.time[frame].toFixed(1) + ' s';
    const mean = (name) => s[name].reduce((sum, values) => sum + values[frame], 0) / s[name].length;
    const largest = Math.max(...s.tip.map(at));
    const rows = [
      ['Wind at the hub', at(s.wind).toFixed(1) + ' m/s'], ['Power', at(s.power).toFixed(2) + ' MW'],
      ['Rotor speed', at(s.speed).toFixed(2) + ' rpm'], ['Pitch, mean', mean('pitch').toFixed(1) + '°'],
      ['Tip deflection, largest', largest.toFixed(2) + ' m'],
      ...(data.sea ? [['Platform pitch', at(s.platform_pitch).toFixed(1) + '°']] : []),
    ];
    find('numbers').innerHTML = rows.map(([name, value]) => '<div><dt>' + name + '</dt><dd>' + value + '</dd></div>').join('');
  }

  // ---------------------------------------------------------------- controls
  function draw() {
    const lastFrame = current.time.length - 1;
    position = Math.min(position, lastFrame);
    const frame = Math.min(Math.floor(position), lastFrame), a = position - frame;
    drawScene(frame, a);
    drawCharts(frame, a);
    showNumbers(frame);
    slider.value = position;
  }

  function tick(now) {
    if (!playing) return;
    if (last !== null) position += speed * (now - last) / 1000 / data.dt;
    last = now;
    if (position >= current.time.length - 1) position = 0;
    draw();
    requestAnimationFrame(tick);
  }

  function play(on) {
    playing = on;
    playButton.textContent = on ? '❚❚ Pause' : '▶ Play';
    if (on) { last = null; requestAnimationFrame(tick); }
  }

  agents.forEach((agent, k) => find('agent').add(new Option(agent.name, k, false, agent === current)));
  find('agent').addEventListener('change', (event) => {
    current = agents[event.target.value];
    slider.max = current.time.length - 1;
    draw();
  });
  find('speed').addEventListener('change', (event) => { speed = Number(event.target.value); });
  playButton.addEventListener('click', () => play(!playing));
  slider.max = current.time.length - 1;
  slider.addEventListener('input', () => { play(false); position = Number(slider.value); draw(); });
  for (const button of root.querySelectorAll('[data-view]')) {
    button.addEventListener('click', () => { [azimuth, elevation] = VIEWS[button.dataset.view]; draw(); });
  }
  for (const button of root.querySelectorAll('[data-zoom]')) {
    button.addEventListener('click', () => { zoom = Math.min(6, Math.max(0.4, zoom * Number(button.dataset.zoom))); draw(); });
  }
  let held = null;
  canvas.addEventListener('pointerdown', (event) => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener('pointermove', (event) => {
    if (!held) return;
    azimuth -= 0.008 * (event.clientX - held[0]);
    elevation = Math.min(1.5, Math.max(-0.1, elevation + 0.008 * (event.clientY - held[1])));
    held = [event.clientX, event.clientY];
    draw();
  });
  for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, () => { held = null; });
  window.addEventListener('resize', draw);
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
  draw();
})();
