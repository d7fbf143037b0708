// What of a page is not as it should be, and where its parts are, as a browser lays it out.

// Elements that reach beyond the page, unless a box of their own scrolls them.
function overflow() {
  const edge = document.documentElement.clientWidth + 0.5, found = [];
  for (const e of document.querySelectorAll('body *')) {
    const box = e.getBoundingClientRect();
    if (box.width === 0 || e.closest('svg') !== null && e.tagName !== 'svg') continue;
    const scrolled = e.parentElement.closest('.scroll');
    if (scrolled === null && (box.right > edge || box.left < -0.5))
      found.push(e.tagName + ' ' + e.className + ' ' + Math.round(box.right));
  }
  if (document.documentElement.scrollWidth > edge) found.push('page scrolls sideways');
  return found;
}

// Blocks that lie over each other, and tables that have to be scrolled.
function covered() {
  const found = [...document.querySelectorAll('div.scroll')].filter(
    e => e.scrollWidth > e.clientWidth + 1).map(e => 'scrolled: ' + e.textContent.slice(0, 60));
  const blocks = [...document.querySelectorAll(
    'header > *, h2, .steps li, .scroll, .tiles, figure, section > p, section > dl, .sign, footer')
    ].map(e => [e, e.getBoundingClientRect()]).filter(([e, box]) => box.height > 0);
  blocks.forEach(([one, a], k) => blocks.slice(0, k).forEach(([other, b]) => {
    if (!one.contains(other) && !other.contains(one) && a.left < b.right - 1
        && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1)
      found.push(one.textContent.slice(0, 40) + ' / ' + other.textContent.slice(0, 40));
  }));
  return found;
}

// Texts of a picture that are cut off at its edge by more than a letter.
function cut() {
  const found = [];
  for (const svg of document.querySelectorAll('svg')) {
    const frame = svg.getBoundingClientRect();
    for (const e of svg.querySelectorAll('text')) {
      const box = e.getBoundingClientRect();
      if (box.right > frame.right + 8 || box.left < frame.left - 8
          || box.bottom > frame.bottom + 8 || box.top < frame.top - 8)
        found.push(svg.querySelector('title').textContent + ': ' + e.textContent);
    }
  }
  return found;
}

// Texts of pictures that are smaller than 10 px, and such as overprint each other.
function small() {
  return [...document.querySelectorAll('svg text')].filter(e => {
    const svg = e.ownerSVGElement, scale = svg.getBoundingClientRect().width
      / svg.viewBox.baseVal.width;
    return parseFloat(getComputedStyle(e).fontSize) * scale < 9.99;
  }).map(e => e.textContent);
}

function overprinted() {
  const found = [];
  for (const svg of document.querySelectorAll('svg')) {
    const texts = [...svg.querySelectorAll('text')].map(
      e => [e.getBoundingClientRect(), e.textContent]);
    texts.forEach(([a, one], k) => texts.slice(0, k).forEach(([b, other]) => {
      if (a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 6
          && b.top < a.bottom - 6) found.push(one + ' / ' + other);
    }));
  }
  return found;
}

// Colour of every text and of what lies behind it, as the browser computed them.
function colours() {
  const behind = e => {
    for (; e; e = e.parentElement) {
      const c = getComputedStyle(e).backgroundColor;
      if (c !== 'rgba(0, 0, 0, 0)') return c;
    }
    return 'rgb(255, 255, 255)';
  };
  return [...document.querySelectorAll('h1, h2, p, td, th, dt, dd, li, code, footer')]
    .filter(e => e.textContent.trim() && !e.closest('svg'))
    .map(e => [e.tagName, getComputedStyle(e).color, behind(e)]);
}

// Lines of pictures: name, colour, opacity.
function strokes() {
  return [...document.querySelectorAll('.rail, .bar, .thread, .whisker, .due')].map(
    e => (s => [e.className.baseVal, s.stroke, s.strokeOpacity])(getComputedStyle(e)));
}

// Edges of all elements of that kind: left, right, top, bottom.
function boxes(selector) {
  return [...document.querySelectorAll(selector)].map(
    e => (b => [b.left, b.right, b.top, b.bottom])(e.getBoundingClientRect()));
}

function fills(selector) {
  return [...document.querySelectorAll(selector)].map(e => getComputedStyle(e).fill);
}
